//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use evac_simulator::WorldKind;
use evac_stage::{LogOptions, RunOptions};

/// LiDAR and IMU mapping of evacuation routes: a walk in, an OctoMap and a flat map out.
///
/// Every stage is a process of its own; frames travel through shared memory.
#[derive(Debug, Parser)]
#[command(name = "evac", version, about, max_term_width = 110)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// What `evac` can do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Walk through a simulated building and map it
    ///
    /// Starts the whole pipeline as processes and writes map.ot, map.bt, plan.pgm, plan.yaml, plan.png, trajectory.tum,
    /// truth.tum, cloud.pcd and summary.json.
    Demo(DemoArgs),
    /// Map a recording
    ///
    /// Lossless, as fast as it goes, and the same result every time. Writes map.ot, map.bt, plan.pgm, plan.yaml, plan.png,
    /// trajectory.tum, cloud.pcd and summary.json.
    #[command(after_help = MAP_HELP)]
    Map(MapArgs),
    /// Find from a walk with turns how the IMU sits, keeps time and reads beside the LiDAR
    ///
    /// Prints the offset between the clocks, the rotation of [rig.imu_from_lidar] and the gyroscope's scale, each with
    /// its standard error, and says what the motion has not shown.
    Calibrate(crate::calibrate::CalibrateArgs),
    /// Run a pipeline file until it ends or SIGTERM comes
    Up(UpArgs),
    /// Stop the pipeline that runs in a pipeline file's domain
    Down(DomainArgs),
    /// Replace a stage while the pipeline runs
    ///
    /// The new instance starts beside the old one, follows it until it could go on in its place, and takes over between two
    /// frames: none is lost and none comes twice. If it does not get ready the old one goes on. Without options the same
    /// stage is started anew, or a standby that is ready takes over.
    #[command(visible_alias = "restart")]
    Swap(SwapArgs),
    /// Start a second instance that takes over when the first one dies
    Standby(SwapArgs),
    /// Run a second instance of a processor on the same input, unheard, to compare it
    Shadow(ShadowArgs),
    /// Let what runs as a stage's shadow take its place
    ///
    /// A new instance of the shadow's executable and configuration follows the routed one until it could go on in its place, and takes
    /// over as by `evac swap`: the shadow itself has gone its own way. It is ended afterwards.
    Promote(PromoteArgs),
    /// Compare a stage with its shadow, or two odometries over a recording: deviation, latency and CPU
    #[command(after_help = crate::compare::COMPARE_HELP)]
    Compare(crate::compare::CompareArgs),
    /// Show every stage of a running pipeline: who is routed, state, rate, age, losses, latency, CPU and memory
    Status(StatusArgs),
    /// Show the same live on a terminal; also over ssh, NO_COLOR is heeded, q quits
    Top(DomainArgs),
    /// Follow one frame through all stages: when it was handed over, received, taken up and done
    Trace(crate::trace::TraceArgs),
    /// Check a pipeline file without starting anything
    Check(CheckArgs),
    /// Find what would stop or spoil a run on this machine, and say what to do
    ///
    /// Shared memory, clocks, processor, serial ports, socket buffers, and the devices of a pipeline file. Code 4 where
    /// something would stop a run.
    Doctor(crate::doctor::DoctorArgs),
    /// Run one stage in this process
    #[command(
        after_help = "Kinds: simulator, replay, device_simulator, lidar, imu, deskewer, lio, loam, octree_mapper, grid_exporter, \
                      map_saver, recorder"
    )]
    Stage(StageArgs),
    /// Print every service and layout of shared memory as JSON, for stages in other languages
    Services,
    /// Turn a point cloud into octree files, voxel centres and flat maps
    ///
    /// One hit a point and no rays, as OctoMap's updateNode(point, true): the same file byte for byte.
    #[command(after_help = crate::convert::CONVERT_HELP)]
    Convert(crate::convert::ConvertArgs),
    /// Measure the odometry: accuracy, faults, the paper's Table 1, an hour's walk
    Experiment(crate::experiment::ExperimentArgs),
    /// Compare trajectories with the truth
    ///
    /// Prints APE, RPE, end drift and the heights' figures of every estimate, and writes evaluation.json, path.png (from
    /// above) and axes.png (x, y and z over time).
    #[command(after_help = EVAL_HELP)]
    Eval(EvalArgs),
}

const EVAL_HELP: &str = "Trajectories are TUM files, `seconds tx ty tz qx qy qz qw` a line. Figures are defined as evo's:\n  \
    APE, SE(3) aligned     after the best rigid alignment of all positions (evo_ape --align)\n  \
    APE, first aligned     after laying the first poses on each other (evo_ape --align_origin)\n  \
    RPE over 1 s, 1 m      all pairs a second, or a metre of true path, apart (evo_rpe --all_pairs)\n  \
    z above the start      the ten figures of the paper's Table 1, first poses aligned\n\n\
    Between poses of the truth at most 1 s apart it is interpolated.";

pub(crate) const MAP_HELP: &str = "Recordings:\n  \
    WALK.bag               ROS 1 bag: livox_ros_driver/CustomMsg or sensor_msgs/PointCloud2, and sensor_msgs/Imu\n  \
    WALK.mcap, WALK.db3    ROS 2 bag with the same messages, or livox_ros_driver2/CustomMsg; or its folder\n  \
    recordings/NAME        folder of evac's own recorder: the same poses and maps as when it was recorded\n  \
    --lidar X.pcap         UDP capture of a Livox device, of either protocol (SDK1, SDK2)\n  \
    --lidar X.lvx, X.lvx2  recording of Livox Viewer: LVX 1.0, 1.1, LVX2\n  \
    --imu Y.bin            bytes of a WT901C as they came over the serial line; a log without time frames is\n                         \
    taken as evenly sampled from the first LiDAR packet's device time on\n\n\
    Rig file:\n  [rig.imu_from_lidar]\n  translation_m = [0.05, -0.02, 0.06]       # LiDAR origin in the IMU frame\n  \
    roll_pitch_yaw_deg = [0.5, -1.0, 1.5]     # R = Rz Ry Rx takes LiDAR to IMU coordinates";

/// Stages that say where the LiDAR is.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum Odometry {
    /// LiDAR and IMU coupled tightly, point to plane without features.
    Lio,
    /// The paper's: features of Loam-Livox, with the IMU for deskewing and as prior.
    Loam,
}

#[derive(Debug, Args)]
pub(crate) struct OdometryArgs {
    /// Which odometry
    #[arg(long, value_enum, default_value_t = Odometry::Lio)]
    pub(crate) odometry: Odometry,
    /// Leave the motion inside the scans; loam then uses no IMU at all (the paper's comparison)
    #[arg(long)]
    pub(crate) no_deskewing: bool,
}

#[derive(Debug, Args)]
pub(crate) struct DemoArgs {
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", default_value = "evac-out")]
    pub(crate) output: PathBuf,
    /// Seed of noise, biases and gait
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// The building
    #[arg(long, value_enum, default_value_t = WorldKind::Corridor)]
    pub(crate) world: WorldKind,
    /// Which building of a kind that is drawn from a number
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub(crate) building: u64,
    /// End the walk after this many seconds
    #[arg(long, value_name = "SECONDS")]
    pub(crate) duration: Option<f64>,
    /// Also write the walk as a recording (lidar.pcap, wt901c.bin, truth.tum, rig.toml)
    #[arg(long, value_name = "DIR")]
    pub(crate) record: Option<PathBuf>,
    /// Run in real time instead of as fast as it goes
    #[arg(long)]
    pub(crate) real_time: bool,
    #[command(flatten)]
    pub(crate) devices: crate::devices::DevicesArgs,
    #[command(flatten)]
    pub(crate) odometry: OdometryArgs,
    /// Edge of a voxel, metres
    #[arg(long, value_name = "METRES")]
    pub(crate) resolution: Option<f64>,
    /// Space of shared-memory services
    #[arg(long, default_value = "evac")]
    pub(crate) domain: String,
    #[command(flatten)]
    pub(crate) log: LogOptions,
}

/// A recording and the rig that it was made with.
#[derive(Debug, Args)]
pub(crate) struct RecordingArgs {
    /// Bag with LiDAR and IMU: ROS 1, ROS 2 (MCAP, db3) or evac's own recorder; a file or a folder
    #[arg(value_name = "WALK", required_unless_present = "lidar", conflicts_with_all = ["lidar", "imu"])]
    pub(crate) bag: Option<PathBuf>,
    /// UDP capture of a Livox device, or a recording of Livox Viewer
    #[arg(long, value_name = "X.pcap|X.lvx|X.lvx2")]
    pub(crate) lidar: Option<PathBuf>,
    /// Byte log of a WT901C [default: the LiDAR's own IMU in the capture]
    #[arg(long, value_name = "Y.bin", requires = "lidar")]
    pub(crate) imu: Option<PathBuf>,
    /// Samples per second of the byte log
    #[arg(long, value_name = "HZ", default_value_t = 200.0)]
    pub(crate) imu_rate: f64,
    /// Added to the byte log's times
    #[arg(long, value_name = "MS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(crate) imu_offset_ms: f64,
    /// Use a recording that was cut, up to the cut
    #[arg(long)]
    pub(crate) allow_truncated: bool,
    /// Where the LiDAR sits on the IMU [default: both in one place]
    #[arg(long, value_name = "RIG.toml")]
    pub(crate) rig: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct MapArgs {
    #[command(flatten)]
    pub(crate) recording: RecordingArgs,
    /// Leave out this much at the start
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    pub(crate) start: f64,
    /// End after this much [default: at the recording's end]
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, hide_default_value = true)]
    pub(crate) duration: f64,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", default_value = "evac-out")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) odometry: OdometryArgs,
    /// Edge of a voxel, metres
    #[arg(long, value_name = "METRES")]
    pub(crate) resolution: Option<f64>,
    /// Run live, this many times faster than it was recorded, instead of lossless and as fast as it goes
    #[arg(long, value_name = "FACTOR")]
    pub(crate) rate: Option<f64>,
    /// Wait for a line on standard input: an empty one lets the next scan go, a number so many, the end of input the rest
    #[arg(long)]
    pub(crate) step: bool,
    /// True trajectory; adds the drift to the summary
    #[arg(long, value_name = "TRUTH.tum")]
    pub(crate) truth: Option<PathBuf>,
    /// Space of shared-memory services [default: one of its own, so that several can run at once]
    #[arg(long)]
    pub(crate) domain: Option<String>,
    #[command(flatten)]
    pub(crate) log: LogOptions,
}

#[derive(Debug, Args)]
pub(crate) struct UpArgs {
    /// Pipeline file
    #[arg(value_name = "PIPELINE.toml")]
    pub(crate) pipeline: PathBuf,
    /// Space of shared-memory services [default: the pipeline file's, or evac]
    #[arg(long)]
    pub(crate) domain: Option<String>,
    #[command(flatten)]
    pub(crate) log: LogOptions,
}

#[derive(Debug, Args)]
pub(crate) struct DomainArgs {
    /// Pipeline file [default: the domain evac]
    #[arg(value_name = "PIPELINE.toml")]
    pub(crate) pipeline: Option<PathBuf>,
    /// Space of shared-memory services [default: the pipeline file's, or evac]
    #[arg(long)]
    pub(crate) domain: Option<String>,
}

#[derive(Debug, Args)]
pub(crate) struct SwapArgs {
    /// Name of the stage in the pipeline file; `odometry` is whichever there is
    #[arg(value_name = "STAGE")]
    pub(crate) stage: String,
    /// Another kind that writes the same, for example loam in the place of lio
    #[arg(long)]
    pub(crate) kind: Option<String>,
    /// Another executable that keeps the contract, and its first arguments; to be given last
    #[arg(long, value_name = "EXECUTABLE", num_args = 1.., allow_hyphen_values = true)]
    pub(crate) run: Option<Vec<PathBuf>>,
    /// Pipeline file with the new instance's configuration [default: as it is; for another kind its defaults]
    #[arg(long, value_name = "PIPELINE.toml")]
    pub(crate) config: Option<PathBuf>,
    /// Longest time until the new instance is ready
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0)]
    pub(crate) patience: f64,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
    /// Space of shared-memory services [default: evac]
    #[arg(long)]
    pub(crate) domain: Option<String>,
}

#[derive(Debug, Args)]
pub(crate) struct ShadowArgs {
    /// End the shadow
    #[arg(long, conflicts_with_all = ["kind", "run", "config"])]
    pub(crate) stop: bool,
    #[command(flatten)]
    pub(crate) swap: SwapArgs,
}

#[derive(Debug, Clone, Args)]
pub(crate) struct PromoteArgs {
    /// Name of the stage in the pipeline file; `odometry` is whichever there is
    #[arg(value_name = "STAGE")]
    pub(crate) stage: String,
    /// Longest time until the new instance is ready
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0)]
    pub(crate) patience: f64,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
    /// Space of shared-memory services [default: evac]
    #[arg(long)]
    pub(crate) domain: Option<String>,
}

#[derive(Debug, Args)]
pub(crate) struct StatusArgs {
    #[command(flatten)]
    pub(crate) domain: DomainArgs,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct CheckArgs {
    /// Pipeline file
    #[arg(value_name = "PIPELINE.toml")]
    pub(crate) pipeline: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct StageArgs {
    /// Which kind of stage
    #[arg(value_name = "NAME")]
    pub(crate) kind: String,
    #[command(flatten)]
    pub(crate) options: RunOptions,
}

#[derive(Debug, Args)]
pub(crate) struct EvalArgs {
    /// True trajectory
    #[arg(value_name = "TRUTH.tum")]
    pub(crate) truth: PathBuf,
    /// Estimated trajectories, one column and one line each
    #[arg(value_name = "ESTIMATE.tum", required = true)]
    pub(crate) estimates: Vec<PathBuf>,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", default_value = "evac-eval")]
    pub(crate) output: PathBuf,
    /// Print JSON instead of the table
    #[arg(long)]
    pub(crate) json: bool,
    /// Compare stamps as they are [default: times since the first pose of each file]
    #[arg(long)]
    pub(crate) absolute_time: bool,
}

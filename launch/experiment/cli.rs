//! The command line of `evac experiment`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use crate::cli::OdometryArgs;

#[derive(Debug, Args)]
pub(crate) struct ExperimentArgs {
    #[command(subcommand)]
    pub(crate) experiment: Experiment,
}

/// What is measured.
#[derive(Debug, Subcommand)]
pub(crate) enum Experiment {
    /// How good trajectories are: recorded and simulated walks, one line a run, and the limits of accuracy
    #[command(after_help = COLUMNS)]
    Walks(WalksArgs),
    /// What faults do: every walk with every fault, and which of them it holds
    #[command(after_help = RULE)]
    Faults(FaultsArgs),
    /// Whether published errors are true: share of errors within three sigma, and directions said before blank walls
    Honesty(HonestyArgs),
    /// Repeat the paper's Table 1 and Figures 8 and 9 on a simulated corridor loop
    ///
    /// Prints the ten figures of the height and the displacement of the end point for every method, and writes table1.md,
    /// table1.json, path.png (Figure 8: from above) and axes.png (Figure 9: x, y and z).
    Table1(Table1Args),
    /// Repeat the paper's Table 2: a cloud of 990,768 points with its ground and without, at three resolutions
    ///
    /// Prints conversion time, points, voxels and file sizes of the six conditions, and writes table2.md, table2.json, maps.png
    /// (the six maps from above) and every map as .bt, .ot and voxel centres.
    Table2(Table2Args),
    /// An hour's walk through the real processes: is the time of a frame flat, is memory bounded?
    ///
    /// Simulator, deskewer and lio run as processes over shared memory, as fast as they go. Prints one line a simulated
    /// minute and writes soak.json, soak.png and pipeline.toml.
    Soak(SoakArgs),
    /// Swap stage after stage in a walk: is a frame lost, does one come twice, does the pose jump?
    ///
    /// The whole pipeline runs as processes in real time; deskewer, odometry (lio and loam in turn), mapper, grid exporter and
    /// map saver are swapped one after the other. Prints the figures and writes swaps.json beside the results of the walk.
    Swaps(SwapsArgs),
    /// Kill each stage without a standby in a walk: how long until the pipeline is whole again, and what does it cost?
    ///
    /// The whole pipeline runs as processes in real time, with a recorder; one stage after the other is killed (SIGKILL). Prints for
    /// each when the new process is up, when its first new frame comes, and when every sink is done with the first scan after the
    /// death, with the limit of a second; writes restarts.json beside the results of the walk.
    Restarts(RestartsArgs),
}

#[derive(Debug, Args)]
pub(crate) struct RestartsArgs {
    /// How often each stage is killed; a round takes a minute, as a stage that crashes more often is started again later
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=60))]
    pub(crate) rounds: u32,
    /// Only these stages in turn; several may be given with commas
    #[arg(long, value_name = "STAGE", value_delimiter = ',', default_values = super::restarts::STAGES)]
    pub(crate) only: Vec<String>,
    /// Seed of noise, biases and gait
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", default_value = "evac-restarts")]
    pub(crate) output: PathBuf,
    /// Space of shared-memory services [default: one of its own, so that several can run at once]
    #[arg(long)]
    pub(crate) domain: Option<String>,
    #[command(flatten)]
    pub(crate) log: evac_stage::LogOptions,
}

#[derive(Debug, Args)]
pub(crate) struct SwapsArgs {
    /// How many swaps
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub(crate) swaps: u32,
    /// Kill the instance that leads (SIGKILL) beside a standby instead
    #[arg(long)]
    pub(crate) kill: bool,
    /// Only these stages in turn; several may be given with commas
    #[arg(long, value_name = "STAGE", value_delimiter = ',', default_values = super::swaps::TURNS)]
    pub(crate) only: Vec<String>,
    /// Seed of noise, biases and gait
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", default_value = "evac-swaps")]
    pub(crate) output: PathBuf,
    /// Space of shared-memory services [default: one of its own, so that several can run at once]
    #[arg(long)]
    pub(crate) domain: Option<String>,
    #[command(flatten)]
    pub(crate) log: evac_stage::LogOptions,
}

const COLUMNS: &str = "Columns (metres, degrees, milliseconds):\n  \
    APE, max        position error after SE(3) alignment, root mean square and largest\n  \
    drift, rot      error of the last pose, first poses laid on each other\n  \
    z std           standard deviation of the height's error, SE(3) aligned\n  \
    3sig, 3mah      share of frames with an error within 3 published sigma: of the worst axis, of the error's direction\n  \
    jump            largest length of a published step beyond the true one\n  \
    degen, lost     frames that say so\n  \
    recov, time     longest loss in seconds; whether the error was below 0.5 m until \"lost\" was said\n  \
    ms, p99, desk   time computed for a frame by the odometry (median, 99th percentile) and the deskewer (median)\n  \
    verdict         the rule of `evac experiment faults`";

const RULE: &str = "A run holds a fault if its APE is within 0.2 m (held); or if \"lost\" was said before the error passed\n\
    0.5 m, was over within 5 s, and every stretch before and after it has an APE within 0.2 m (recovered). In no case may\n\
    a step between two frames be more than 0.3 m longer than the true one.";

/// Which walks, with what configuration, how fast.
#[derive(Debug, Args)]
pub(crate) struct Selection {
    /// Only walks whose name contains this; several may be given with commas
    #[arg(long, value_name = "PART", value_delimiter = ',')]
    pub(crate) only: Vec<String>,
    #[command(flatten)]
    pub(crate) odometry: OdometryArgs,
    /// Change a key of a stage's configuration, written as in a pipeline file; may be given several times
    #[arg(long = "set", value_name = "STAGE.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// End every walk after this many seconds
    #[arg(long, value_name = "SECONDS")]
    pub(crate) duration: Option<f64>,
    /// Walks worked on at the same time; figures do not depend on it, times of a frame do a little
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub(crate) threads: usize,
    /// Folder with recordings (simulated/corridor and so on) and the measured hall (real/livox_mid40_hall_map) [default: $EVAC_DATA, or ../shared/data]
    #[arg(long, value_name = "DIR")]
    pub(crate) data: Option<PathBuf>,
    /// Series of the simulated walks: others have other buildings, noise, gaits and rigs of the same kinds; series 0 was tuned on
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u64).range(..1000))]
    pub(crate) series: u64,
    /// Seed of what is random in the faults
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Also write the table as Markdown and all figures as JSON into this folder
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct WalksArgs {
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// Faults to lay over every walk, with commas: none, auto-zero, ... or all
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_values = ["none"])]
    pub(crate) fault: Vec<String>,
}

#[derive(Debug, Args)]
pub(crate) struct FaultsArgs {
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// Only these faults, with commas
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_values = ["all"])]
    pub(crate) fault: Vec<String>,
}

#[derive(Debug, Args)]
pub(crate) struct HonestyArgs {
    #[command(flatten)]
    pub(crate) selection: Selection,
}

#[derive(Debug, Args)]
pub(crate) struct Table1Args {
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", default_value = "evac-table1")]
    pub(crate) output: PathBuf,
    /// Seed of noise, biases and gait
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// End the walk after this many seconds
    #[arg(long, value_name = "SECONDS")]
    pub(crate) duration: Option<f64>,
}

#[derive(Debug, Args)]
pub(crate) struct Table2Args {
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", default_value = "evac-table2")]
    pub(crate) output: PathBuf,
    /// Cloud to convert (PCD, PLY, LAS/LAZ) [default: 990,768 points of a simulated walk through the station hall]
    #[arg(long, value_name = "CLOUD")]
    pub(crate) cloud: Option<PathBuf>,
    /// Seed of the simulated walk
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
}

#[derive(Debug, Args)]
pub(crate) struct SoakArgs {
    /// Simulated minutes, at most 60
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=60))]
    pub(crate) minutes: u32,
    /// The building
    #[arg(long, value_enum, default_value_t = SoakWorld::Corridor)]
    pub(crate) world: SoakWorld,
    /// Seed of noise, biases and gait
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", default_value = "evac-soak")]
    pub(crate) output: PathBuf,
    /// Space of shared-memory services [default: one of its own, so that several can run at once]
    #[arg(long)]
    pub(crate) domain: Option<String>,
    #[command(flatten)]
    pub(crate) log: evac_stage::LogOptions,
}

/// Worlds whose route ends where it began.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub(crate) enum SoakWorld {
    /// A basement corridor in a loop.
    Corridor,
    /// A station hall with pillars and walking people.
    Hall,
}

impl SoakWorld {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Corridor => "corridor",
            Self::Hall => "hall",
        }
    }
}

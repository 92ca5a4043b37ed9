//! The command line of `evac compare`.

use std::path::PathBuf;

use clap::Args;

use crate::cli::Odometry;

pub(crate) const COMPARE_HELP: &str = "Live (STAGE): the instance that leads beside its shadow (evac shadow), frame by frame.\n  \
    odometry    distance and angle between the two poses of a frame\n  \
    deskewer    distances of the points of a scan, root mean square and largest\n  \
    mapper      voxels in which the two maps differ, of all that either has changed since\n\n\
    Recording: both odometries over the same recording, as fast as they go.\n\n\
    Prints a table and writes compare.json (with every frame) and compare.png.";

#[derive(Debug, Args)]
pub(crate) struct CompareArgs {
    /// Stage of a running pipeline that has a shadow, or a recording as of `evac map`
    #[arg(value_name = "STAGE|RECORDING")]
    pub(crate) what: PathBuf,
    /// First odometry over a recording
    #[arg(long, value_enum, value_name = "KIND", requires = "b")]
    pub(crate) a: Option<Odometry>,
    /// Second odometry over a recording
    #[arg(long, value_enum, value_name = "KIND", requires = "a")]
    pub(crate) b: Option<Odometry>,
    /// Byte log of a WT901C that belongs to the recording [default: the LiDAR's own IMU]
    #[arg(long, value_name = "Y.bin", requires = "a")]
    pub(crate) imu: Option<PathBuf>,
    /// Where the LiDAR sits on the IMU, for a recording [default: both in one place]
    #[arg(long, value_name = "RIG.toml", requires = "a")]
    pub(crate) rig: Option<PathBuf>,
    /// End after this much [default: with the pipeline, the shadow, the recording, or Ctrl-C]
    #[arg(long, value_name = "SECONDS")]
    pub(crate) duration: Option<f64>,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", default_value = "evac-compare")]
    pub(crate) output: PathBuf,
    /// Print JSON instead of the table
    #[arg(long)]
    pub(crate) json: bool,
    /// Space of shared-memory services [default: evac]
    #[arg(long)]
    pub(crate) domain: Option<String>,
}

//! The command line of `evac experiment`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

#[derive(Debug, Args)]
pub(crate) struct ExperimentArgs {
    #[command(subcommand)]
    pub(crate) experiment: Experiment,
}

/// What is measured.
#[derive(Debug, Subcommand)]
pub(crate) enum Experiment {
    /// Accuracy of the odometry over recorded and simulated walks, one line a run
    Walks(WalksArgs),
}

/// Which walks, with what configuration, how fast.
#[derive(Debug, Args)]
pub(crate) struct Selection {
    /// Only walks whose name contains this
    #[arg(long, value_name = "PART")]
    pub(crate) only: Option<String>,
    /// Change a key of a stage's configuration, written as in a pipeline file; may be given several times
    #[arg(long = "set", value_name = "STAGE.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// End every walk after this many seconds
    #[arg(long, value_name = "SECONDS")]
    pub(crate) duration: Option<f64>,
    /// Walks worked on at the same time; figures do not depend on it, times of a frame do a little
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub(crate) threads: usize,
    /// Folder with the recorded walks [default: $EVAC_DATA, or ../shared/data where it is there]
    #[arg(long, value_name = "DIR")]
    pub(crate) data: Option<PathBuf>,
    /// Seed of what is random in the faults
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
}

#[derive(Debug, Args)]
pub(crate) struct WalksArgs {
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// Lay this fault over every walk, or all of them one after the other
    #[arg(long, value_name = "NAME|all", default_value = "none")]
    pub(crate) fault: String,
}

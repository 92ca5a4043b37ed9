//! The command line of `evac chaos`.

use std::path::PathBuf;

use clap::Args;

#[derive(Debug, Clone, Args)]
pub(crate) struct ChaosArgs {
    /// How long to go on
    #[arg(long, value_name = "MINUTES", default_value_t = 10.0)]
    pub(crate) minutes: f64,
    /// Seed of the faults and of the walk
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Speed of the walk: 1 is real time; less on a computer that is busy, as frames that are lost by overload are no fault's
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub(crate) rate: f64,
    /// A swapped odometry, and its shadow, is of the other kind, lio or loam, each time
    #[arg(long)]
    pub(crate) loam: bool,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", default_value = "evac-chaos")]
    pub(crate) output: PathBuf,
    /// Space of shared-memory services [default: one of its own, so that several can run at once]
    #[arg(long)]
    pub(crate) domain: Option<String>,
    #[command(flatten)]
    pub(crate) log: evac_stage::LogOptions,
}

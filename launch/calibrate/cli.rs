//! The command line of `evac calibrate`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use crate::cli::RecordingArgs;

#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true, after_help = HELP)]
pub(crate) struct CalibrateArgs {
    #[command(subcommand)]
    pub(crate) what: Option<What>,
    /// Without a word for it: all three.
    #[command(flatten)]
    pub(crate) walk: WalkArgs,
}

/// What is wanted; the others are solved for all the same, as each shows in the others.
#[derive(Debug, Subcommand)]
pub(crate) enum What {
    /// The offset between the clocks of LiDAR and IMU only
    Time(WalkArgs),
    /// The rotation between LiDAR and IMU only
    Rotation(WalkArgs),
    /// The gyroscope's scale only
    Scale(WalkArgs),
    /// All three (the same as without a word)
    All(WalkArgs),
}

#[derive(Debug, Args)]
pub(crate) struct WalkArgs {
    #[command(flatten)]
    pub(crate) recording: RecordingArgs,
    /// Use at most so much of the recording, which is held in memory (about 2 MB a second)
    #[arg(long, value_name = "SECONDS", default_value_t = 120.0)]
    pub(crate) duration: f64,
    /// Write the rig file, and calibration.json beside it
    #[arg(short, long, value_name = "RIG.toml")]
    pub(crate) output: Option<PathBuf>,
    /// Print JSON instead of the table
    #[arg(long)]
    pub(crate) json: bool,
}

const HELP: &str = "The walk: two seconds of standing, then about a minute of walking with turns to both sides where walls are in \n\
    view; tilt the rig to the sides and forward and back by 30 degrees a few times. The rig's file may be off by 3 degrees,\n\
    the clocks by 100 ms, the gyroscope by 1 %.\n\n\
    The recording is that of `evac map`. Numbers that the walk hardly shows are warned of; those with standard\n\
    errors above 1 degree or 4 ms are left as they were given.";

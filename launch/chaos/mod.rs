//! `evac chaos`: faults at random while a simulated walk goes on in real time, and what must hold whatever happens.
//!
//! No frame is lost or doubled at the sinks beyond what the launcher states of a fault; the producer is never stalled by others; shared
//! memory, descriptors and memory are where they were; and the map on disk is the mapper's, bit by bit.

mod cli;
mod deed;
mod fault;
mod map;
pub(crate) mod monitor;
mod report;
mod resources;
mod run;
mod shadow;

use std::path::Path;

use evac_config::{Mode, Pipeline};
use evac_formats::write_atomically;
use evac_ports::Domain;
use evac_stage::start_logging;
use toml::Value;

pub(crate) use cli::ChaosArgs;
use run::Run;

use crate::check::check;
use crate::error::LaunchError;
use crate::finite::{create_folder, set, write_pipeline};
use crate::supervisor::Supervisor;

const PIPELINE: &str = include_str!("../pipelines/simulated.toml");
/// Frames without output after which a stage hangs here: more than the 32 that are kept for a reader, so that a writer which waited for
/// one that is stopped would be seen to.
const HANG_FRAMES: u64 = 60;
/// Of the map saver's cloud.
const CLOUD_POINTS: i64 = 200_000;

/// `evac chaos`.
pub(crate) fn chaos(args: &ChaosArgs) -> Result<(), LaunchError> {
    start_logging(&args.log);
    create_folder(&args.output)?;
    let pipeline = pipeline(args)?;
    let file = args.output.join("pipeline.toml");
    write_pipeline(&file, &pipeline)?;
    let own = format!("chaos-{}", std::process::id());
    let domain = Domain::new(args.domain.as_deref().unwrap_or(&own))?;
    let (mut supervisor, wakeups) = Supervisor::start_lasting(&pipeline, &file, &domain, &args.log)?;
    let mut run = Run::new(args, &supervisor, &domain)?;
    run.go_on(&mut supervisor, &wakeups)?;
    let report = run.finish(supervisor, &args.output);
    println!("\n{}", report.table());
    let path = args.output.join("chaos.json");
    write_atomically(&path, |writer| {
        serde_json::to_writer_pretty(&mut *writer, &report).map_err(std::io::Error::from)?;
        std::io::Write::write_all(writer, b"\n")
    })?;
    println!("{}", path.display());
    match report.violations.len() {
        0 => Ok(()),
        count => {
            Err(LaunchError::Silent(format!("{count} things happened that must not; they are listed above")))
        }
    }
}

fn pipeline(args: &ChaosArgs) -> Result<Pipeline, LaunchError> {
    let usage = |cause: String| LaunchError::Run(evac_stage::RunError::Value(cause));
    if !(args.minutes > 0.0 && args.minutes <= 1440.0) {
        return Err(usage(format!("--minutes {} must be above 0 and at most 1440", args.minutes)));
    }
    let mut pipeline = Pipeline::parse(Path::new("simulated.toml"), PIPELINE)?;
    if !(args.rate > 0.0 && args.rate <= 10.0) {
        return Err(usage(format!("--rate {} must be above 0 and at most 10", args.rate)));
    }
    pipeline.mode = Mode::Live;
    pipeline.rate = Some(args.rate);
    pipeline.supervision.hang_after_frames = HANG_FRAMES;
    let seed = i64::try_from(args.seed)
        .map_err(|_| usage(format!("--seed {} is too large; use at most {}", args.seed, i64::MAX)))?;
    set(&mut pipeline, "simulator", "seed", Value::from(seed));
    // A lap takes more than a minute of sensor time.
    let laps = (args.minutes * args.rate.max(1.0)).ceil() as i64 + 3;
    set(&mut pipeline, "simulator", "laps", Value::from(laps));
    // Full before what is held is measured: what a step of the pose adds to it would hide a leak.
    set(&mut pipeline, "map_saver", "max_cloud_points", Value::from(CLOUD_POINTS));
    let folder = std::path::absolute(&args.output)
        .map_err(|cause| LaunchError::Path(format!("{}: {cause}", args.output.display())))?;
    for sink in ["grid_exporter", "map_saver"] {
        set(&mut pipeline, sink, "output_dir", Value::from(folder.display().to_string()));
    }
    check(&pipeline).map_err(usage)?;
    Ok(pipeline)
}

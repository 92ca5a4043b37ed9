//! `evac experiment`: what the odometry holds and what breaks it.

mod cli;
mod line;
mod process;
mod restarts;
mod restarts_report;
mod runs;
mod soak;
mod soak_report;
mod swaps;
mod swaps_monitor;
mod swaps_poses;
mod swaps_report;
mod table1;
mod table2;

use std::io::Write as _;
use std::path::Path;

use evac_experiments::report::{Report, accuracy, honesty, robustness};
use evac_experiments::{ExperimentError, Fault};
use evac_formats::write_atomically;
use evac_stage::RunError;
use serde_json::json;

pub(crate) use cli::ExperimentArgs;
use cli::{Experiment, FaultsArgs, HonestyArgs, Selection, WalksArgs};
use runs::{each_run, faults};

use crate::error::LaunchError;
use crate::finite::create_folder;

/// `evac experiment`.
pub(crate) fn experiment(args: &ExperimentArgs) -> Result<(), LaunchError> {
    match &args.experiment {
        Experiment::Walks(args) => walks(args),
        Experiment::Faults(args) => laid_over(args),
        Experiment::Honesty(args) => told(args),
        Experiment::Table1(args) => table1::table1(args),
        Experiment::Table2(args) => table2::table2(args),
        Experiment::Soak(args) => soak::soak(args),
        Experiment::Swaps(args) => swaps::swaps(args),
        Experiment::Restarts(args) => restarts::restarts(args),
    }
}

fn walks(args: &WalksArgs) -> Result<(), LaunchError> {
    let faults = faults(&args.fault)?;
    println!("{}", line::head());
    let runs = each_run(&args.selection, &faults, |run| println!("{}", line::of(run)))?;
    let report = accuracy(&runs);
    println!("\n{}", report.limits);
    write(&args.selection, "walks", &report)
}

fn laid_over(args: &FaultsArgs) -> Result<(), LaunchError> {
    let faults = faults(&args.fault)?;
    println!("{}", line::head());
    let runs = each_run(&args.selection, &faults, |run| println!("{}", line::of(run)))?;
    let report = robustness(&runs);
    println!("\n{}\n{}", report.table, report.limits);
    write(&args.selection, "faults", &report)
}

fn told(args: &HonestyArgs) -> Result<(), LaunchError> {
    let runs = each_run(&args.selection, &[Fault::None], |_| ())?;
    let report = honesty(&runs);
    println!("{}\n{}", report.table, report.limits);
    write(&args.selection, "honesty", &report)
}

/// Writes `NAME.md` and `NAME.json` where a folder was named.
fn write(selection: &Selection, name: &str, report: &Report) -> Result<(), LaunchError> {
    let Some(folder) = &selection.output else { return Ok(()) };
    create_folder(folder)?;
    let odometry = &selection.odometry;
    let name_of = format!("{:?}", odometry.odometry).to_lowercase();
    let set = selection.set.iter().map(|assignment| format!(" --set {assignment}")).collect::<String>();
    let raw = if odometry.no_deskewing { " --no-deskewing" } else { "" };
    let markdown = format!(
        "`evac experiment {name} --odometry {name_of}{raw}{set}`\n\n{}\n{}",
        report.table, report.limits
    );
    let whole = json!({
        "evac": env!("CARGO_PKG_VERSION"),
        "experiment": name,
        "odometry": name_of,
        "deskewing": !odometry.no_deskewing,
        "set": selection.set,
        "seed": selection.seed,
        "duration_s": selection.duration,
        "acceptance": report.acceptance,
        "runs": report.runs,
    });
    write_text(&folder.join(format!("{name}.md")), &markdown)?;
    write_text(&folder.join(format!("{name}.json")), &format!("{whole:#}\n"))
}

/// Writes a file whole or not at all, and says so.
fn write_text(path: &Path, text: &str) -> Result<(), LaunchError> {
    write_atomically(path, |writer| writer.write_all(text.as_bytes()))?;
    println!("{}", path.display());
    Ok(())
}

fn usage(cause: String) -> LaunchError {
    LaunchError::Run(RunError::Value(cause))
}

impl From<ExperimentError> for LaunchError {
    fn from(error: ExperimentError) -> Self {
        match error {
            ExperimentError::File { .. } => Self::Path(error.to_string()),
            _ => usage(error.to_string()),
        }
    }
}

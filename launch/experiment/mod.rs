//! `evac experiment`: what the odometry holds and what breaks it.

mod cli;
mod line;

use std::path::{Path, PathBuf};

use evac_experiments::{
    ExperimentError, Fault, Figures, Settings, Source, Trajectory, catalogue, in_threads, recorded, run,
};
use evac_stage::RunError;

pub(crate) use cli::ExperimentArgs;
use cli::{Experiment, Selection, WalksArgs};

use crate::error::LaunchError;

/// `evac experiment`.
pub(crate) fn experiment(args: &ExperimentArgs) -> Result<(), LaunchError> {
    match &args.experiment {
        Experiment::Walks(args) => walks(args),
    }
}

fn walks(args: &WalksArgs) -> Result<(), LaunchError> {
    let faults = faults(&args.fault)?;
    println!("{}", line::head());
    each_run(&args.selection, &faults, |source, fault, trajectory, figures| {
        println!("{}", line::of(&source.name, &fault.name(), trajectory, figures));
    })
}

/// Runs every selected walk with every fault and hands the results over in the order of the walks, then of the faults.
fn each_run(
    selection: &Selection,
    faults: &[Fault],
    mut done: impl FnMut(&Source, Fault, &Trajectory, &Figures) + Send,
) -> Result<(), LaunchError> {
    let mut settings = Settings::default();
    for assignment in &selection.set {
        settings.set(assignment)?;
    }
    let sources = sources(selection)?;
    let mut failure = None;
    let work = |index: usize| -> Result<Vec<(Trajectory, Figures)>, ExperimentError> {
        let Some(source) = sources.get(index) else { return Ok(Vec::new()) };
        let walk = source.load(selection.duration)?;
        let runs = faults.iter().map(|fault| {
            let trajectory = run(&fault.applied(&walk, selection.seed), &settings);
            let figures = Figures::of(&trajectory);
            (trajectory, figures)
        });
        Ok(runs.collect())
    };
    in_threads(sources.len(), selection.threads, work, |index, results| match results {
        Ok(results) => {
            for (fault, (trajectory, figures)) in faults.iter().zip(&results) {
                if let Some(source) = sources.get(index) {
                    done(source, *fault, trajectory, figures);
                }
            }
        }
        Err(error) => failure = failure.take().or(Some(error)),
    });
    failure.map_or(Ok(()), |error| Err(error.into()))
}

/// The walks to run.
fn sources(selection: &Selection) -> Result<Vec<Source>, LaunchError> {
    let data = data_folder(selection.data.as_deref());
    let mut sources = recorded(&data);
    if sources.is_empty() {
        eprintln!("the recorded walks are left out: {} has none; set --data or EVAC_DATA", data.display());
    }
    sources.extend(catalogue());
    if let Some(part) = &selection.only {
        let names: Vec<_> = sources.iter().map(|source| source.name.clone()).collect();
        sources.retain(|source| source.name.contains(part.as_str()));
        if sources.is_empty() {
            return Err(usage(format!(
                "--only {part}: no walk has that in its name; the walks are {}",
                names.join(", ")
            )));
        }
    }
    Ok(sources)
}

fn data_folder(given: Option<&Path>) -> PathBuf {
    match given {
        Some(folder) => folder.to_owned(),
        None => std::env::var_os("EVAC_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from),
    }
}

fn faults(name: &str) -> Result<Vec<Fault>, LaunchError> {
    if name == "all" {
        return Ok(Fault::ALL.to_vec());
    }
    let chosen: Vec<_> = Fault::ALL.into_iter().filter(|fault| fault.name() == name).collect();
    if chosen.is_empty() {
        let names: Vec<_> = Fault::ALL.iter().map(|fault| fault.name()).collect();
        return Err(usage(format!(
            "--fault {name}: there is no such fault; the faults are all, {}",
            names.join(", ")
        )));
    }
    Ok(chosen)
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

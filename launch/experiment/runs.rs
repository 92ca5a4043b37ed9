//! All runs that were asked for.

use std::path::{Path, PathBuf};

use evac_experiments::report::Run;
use evac_experiments::{
    ExperimentError, Fault, OdometryKind, Settings, Source, catalogue, in_threads, recorded, run,
};

use super::cli::Selection;
use super::usage;
use crate::cli::Odometry;
use crate::error::LaunchError;
use crate::progress::bar;

/// Runs every selected walk with every fault. `show` gets the results in the order of the walks, then of the faults, as
/// soon as they are there.
pub(super) fn each_run(
    selection: &Selection,
    faults: &[Fault],
    mut show: impl FnMut(&Run) + Send,
) -> Result<Vec<Run>, LaunchError> {
    if selection.duration.is_some_and(|seconds| seconds.is_nan() || seconds < 0.1) {
        return Err(usage("--duration must be at least 0.1 seconds".to_owned()));
    }
    let odometry = match selection.odometry.odometry {
        Odometry::Lio => OdometryKind::Lio,
        Odometry::Loam => OdometryKind::Loam,
    };
    let mut settings = Settings { odometry, ..Settings::default() };
    settings.deskewer.enabled = !selection.odometry.no_deskewing;
    for assignment in &selection.set {
        settings.set(assignment)?;
    }
    let sources = sources(selection)?;
    let bar = bar((sources.len() * faults.len()) as u64, "runs");
    let work = |index: usize| -> Result<Vec<Run>, ExperimentError> {
        let Some(source) = sources.get(index) else { return Ok(Vec::new()) };
        let walk = source.load(selection.duration)?;
        let with = |fault: &Fault| {
            let trajectory = run(&fault.applied(&walk, selection.seed), &settings);
            bar.inc(1);
            Run::new(&source.name, source.group, *fault, &trajectory)
        };
        Ok(faults.iter().map(with).collect())
    };
    let (mut all, mut failure) = (Vec::new(), None);
    in_threads(sources.len(), selection.threads, work, |_, runs| match runs {
        Ok(runs) => {
            bar.suspend(|| runs.iter().for_each(&mut show));
            all.extend(runs);
        }
        Err(error) => failure = failure.take().or(Some(error)),
    });
    bar.finish_and_clear();
    failure.map_or(Ok(all), |error| Err(error.into()))
}

/// The faults of these names; `all` is all of them.
pub(super) fn faults(names: &[String]) -> Result<Vec<Fault>, LaunchError> {
    if names.iter().any(|name| name == "all") {
        return Ok(Fault::ALL.to_vec());
    }
    let of_name = |name: &String| {
        Fault::ALL.into_iter().find(|fault| fault.name() == *name).ok_or_else(|| {
            let all: Vec<_> = Fault::ALL.iter().map(|fault| fault.name()).collect();
            usage(format!("--fault {name}: there is no such fault; the faults are all, {}", all.join(", ")))
        })
    };
    names.iter().map(of_name).collect()
}

/// The walks to run.
fn sources(selection: &Selection) -> Result<Vec<Source>, LaunchError> {
    let data = data_folder(selection.data.as_deref());
    let mut sources = recorded(&data);
    let none_recorded = sources.is_empty();
    sources.extend(catalogue(&data, selection.series));
    let names: Vec<_> = sources.iter().map(|source| source.name.clone()).collect();
    for part in &selection.only {
        if !names.iter().any(|name| name.contains(part.as_str())) {
            let names = names.join(", ");
            return Err(usage(format!("--only {part}: no walk has that in its name; the walks are {names}")));
        }
    }
    if !selection.only.is_empty() {
        sources.retain(|source| selection.only.iter().any(|part| source.name.contains(part.as_str())));
    } else if none_recorded {
        eprintln!(
            "skipped: {} has no recorded walks; name their folder with --data or EVAC_DATA",
            data.display()
        );
    }
    Ok(sources)
}

fn data_folder(given: Option<&Path>) -> PathBuf {
    match given {
        Some(folder) => folder.to_owned(),
        None => std::env::var_os("EVAC_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from),
    }
}

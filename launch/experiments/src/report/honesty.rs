//! Whether what is published about errors is true.

use super::{Acceptance, Report, Run, Table};

/// One row a run: errors within the published deviations, and directions said before blank walls.
pub fn honesty(runs: &[Run]) -> Report {
    let mut table = Table::new(&[
        "walk",
        "frames",
        "3 sigma, worst axis",
        "3 sigma, own direction",
        "blank walls",
        "flagged",
        "frames before them",
        "flagged in the plane",
        "out of it",
    ]);
    let share = |share: f64| format!("{:.1} %", 100.0 * share);
    for Run { walk, figures, .. } in runs {
        table.row([
            walk.clone(),
            figures.frames.to_string(),
            share(figures.within_3_sigma),
            share(figures.within_3_mahalanobis),
            figures.corners.corners.to_string(),
            figures.corners.flagged.to_string(),
            figures.corners.frames.to_string(),
            figures.corners.frames_flagged.to_string(),
            figures.corners.frames_wrong.to_string(),
        ]);
    }
    let frames: usize = runs.iter().map(|run| run.figures.frames).sum();
    let within = |of: fn(&Run) -> f64| {
        runs.iter().map(|run| of(run) * run.figures.frames as f64).sum::<f64>() / frames.max(1) as f64
    };
    let [corners, flagged] = [
        runs.iter().map(|run| run.figures.corners.corners).sum::<usize>() as f64,
        runs.iter().map(|run| run.figures.corners.flagged).sum::<usize>() as f64,
    ];
    let acceptance = vec![
        Acceptance::at_least(
            "frames within 3 sigma of the worst axis, %",
            100.0 * within(|run| run.figures.within_3_sigma),
            95.0,
        ),
        Acceptance::at_least("blank walls flagged in the right directions", flagged, corners),
    ];
    Report::new(&table, acceptance, runs)
}

//! The figures as a table: one row a figure, one column a trajectory.

use std::fmt::Write as _;

use evac_evaluation::{Evaluation, Figures, Statistics};

use super::Evaluated;

/// Width of the figures' names and the least of a column, characters.
const NAME: usize = 24;
const COLUMN: usize = 12;

type Statistic = fn(&Evaluation) -> Option<Statistics>;
type Heights = fn(&Evaluation) -> &Figures;
type Figure = (&'static str, fn(&Statistics) -> f64);

/// Figures of a statistic that are shown; evaluation.json has them all.
const ALL: &[Figure] = &[
    ("  rmse", |s| s.rmse),
    ("  mean", |s| s.mean),
    ("  median", |s| s.median),
    ("  std", |s| s.std),
    ("  max", |s| s.max),
];
const SOME: &[Figure] = &[("  rmse", |s| s.rmse), ("  median", |s| s.median), ("  max", |s| s.max)];
const ENDS: &[Figure] = &[("  rmse", |s| s.rmse), ("  max", |s| s.max)];

/// One line: a heading, or a figure of every trajectory.
struct Row {
    name: String,
    values: Vec<String>,
}

/// The whole table.
pub(super) fn table(evaluated: &[Evaluated]) -> String {
    let rows = rows(evaluated);
    let width = evaluated.iter().map(|one| one.name.chars().count() + 2).fold(COLUMN, usize::max);
    let mut text = format!("{:NAME$}", "");
    for one in evaluated {
        let _ = write!(text, "{:>width$}", one.name);
    }
    text.push('\n');
    for row in rows {
        let mut line = format!("{:NAME$}", row.name);
        for value in &row.values {
            let _ = write!(line, "{value:>width$}");
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

fn rows(evaluated: &[Evaluated]) -> Vec<Row> {
    let heading = |name: &str| Row { name: name.to_owned(), values: Vec::new() };
    let count = |name: &str, figure: fn(&Evaluated) -> usize| Row {
        name: name.to_owned(),
        values: evaluated.iter().map(|one| figure(one).to_string()).collect(),
    };
    let number = |name: &str, decimals: usize, figure: &dyn Fn(&Evaluation) -> Option<f64>| Row {
        name: name.to_owned(),
        values: evaluated
            .iter()
            .map(|one| figure(&one.figures).map_or("-".to_owned(), |value| format!("{value:.decimals$}")))
            .collect(),
    };
    let mut rows = vec![
        count("frames", |one| one.figures.frames),
        count("frames without truth", |one| one.frames_without_truth),
        number("true path (m)", 3, &|e| Some(e.path_m)),
        heading("end, first poses aligned"),
        number("  position (m)", 4, &|e| Some(e.end_m)),
        number("  position (% of path)", 4, &|e| Some(e.end_percent)),
        number("  rotation (deg)", 4, &|e| Some(e.end_rotation_deg)),
    ];
    let statistics: [(&str, Statistic, &[Figure]); 8] = [
        ("APE, SE(3) aligned (m)", |e| Some(e.ape_se3), ALL),
        ("APE, first aligned (m)", |e| Some(e.ape_first), ALL),
        ("rotation, SE(3) (deg)", |e| Some(e.rotation_se3_deg), ENDS),
        ("rotation, first (deg)", |e| Some(e.rotation_first_deg), ENDS),
        ("RPE over 1 s (m)", |e| e.rpe_1s.map(|r| r.translation_m), SOME),
        ("RPE over 1 s (deg)", |e| e.rpe_1s.map(|r| r.rotation_deg), SOME),
        ("RPE over 1 m (m)", |e| e.rpe_1m.map(|r| r.translation_m), SOME),
        ("RPE over 1 m (deg)", |e| e.rpe_1m.map(|r| r.rotation_deg), SOME),
    ];
    for (name, statistic, figures) in statistics {
        rows.push(heading(name));
        for (name, figure) in figures {
            rows.push(number(name, 4, &|e| statistic(e).map(|s| figure(&s))));
        }
    }
    let heights: [(&str, Heights); 2] =
        [("z above the start (m)", |e| &e.z_figures), ("z error (m)", |e| &e.z_error_figures)];
    for (name, figures) in heights {
        rows.push(heading(name));
        let Some(first) = evaluated.first() else { continue };
        for (i, (name, _)) in figures(&first.figures).rows().into_iter().enumerate() {
            let decimals = if name == "number" { 0 } else { 6 };
            let figure = |e: &Evaluation| figures(e).rows().get(i).map(|(_, value)| *value);
            rows.push(number(&format!("  {name}"), decimals, &figure));
        }
    }
    rows
}

//! Tables of runs, as Markdown for people and as JSON for programs.

mod accuracy;
mod honesty;
mod robustness;

use serde::Serialize;

use crate::{Fault, Figures, Group, Trajectory, Verdict};

pub use accuracy::accuracy;
pub use honesty::honesty;
pub use robustness::robustness;

/// One run with all that tables need.
#[derive(Debug, Clone, Serialize)]
pub struct Run {
    /// Name of the walk.
    pub walk: String,
    /// Its group.
    pub group: Group,
    /// The fault.
    #[serde(serialize_with = "name")]
    pub fault: Fault,
    /// Whether it holds the rule for faulty walks.
    pub verdict: Verdict,
    /// What the stage said that refused to go on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
    /// Its figures.
    pub figures: Figures,
    /// Median and 99th percentile of the odometry's time a frame, milliseconds.
    pub odometry_ms: [f64; 2],
    /// What the odometry counted.
    pub diagnostics: String,
}

impl Run {
    /// Judges a trajectory.
    pub fn new(walk: &str, group: Group, fault: Fault, trajectory: &Trajectory) -> Self {
        let figures = Figures::of(trajectory);
        Self {
            walk: walk.to_owned(),
            group,
            fault,
            verdict: Verdict::of(trajectory, &figures),
            refused: trajectory.refused.clone(),
            figures,
            odometry_ms: [figures.median_ms, figures.p99_ms],
            diagnostics: trajectory.diagnostics.clone(),
        }
    }
}

fn name<S: serde::Serializer>(fault: &Fault, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&fault.name())
}

/// A figure beside the limit that it is held to.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Acceptance {
    /// What it is.
    pub what: String,
    /// The figure.
    pub value: f64,
    /// The most that it may be, or where `at_least` the least.
    pub limit: f64,
    /// Whether the limit is a lower one.
    pub at_least: bool,
    /// Whether it is kept.
    pub holds: bool,
}

impl Acceptance {
    fn at_most(what: impl Into<String>, value: f64, limit: f64) -> Self {
        Self { what: what.into(), value, limit, at_least: false, holds: value <= limit }
    }

    fn at_least(what: impl Into<String>, value: f64, limit: f64) -> Self {
        Self { what: what.into(), value, limit, at_least: true, holds: value >= limit }
    }
}

/// A table with the limits that its figures are held to.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// The limits.
    pub acceptance: Vec<Acceptance>,
    /// The table in Markdown.
    #[serde(skip)]
    pub table: String,
    /// The limits in Markdown.
    #[serde(skip)]
    pub limits: String,
    /// Every run.
    pub runs: Vec<Run>,
}

impl Report {
    fn new(table: &Table, acceptance: Vec<Acceptance>, runs: &[Run]) -> Self {
        let mut limits = Table::new(&["limit", "measured", "asked for", "holds"]);
        for limit in &acceptance {
            let sign = if limit.at_least { "at least" } else { "at most" };
            limits.row([
                limit.what.clone(),
                short(limit.value),
                format!("{sign} {}", limit.limit),
                if limit.holds { "yes" } else { "**no**" }.to_owned(),
            ]);
        }
        Self { acceptance, table: table.text.clone(), limits: limits.text, runs: runs.to_vec() }
    }
}

/// Four digits after the point, none after a whole number.
fn short(value: f64) -> String {
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// A Markdown table.
#[derive(Debug)]
pub(crate) struct Table {
    pub(crate) text: String,
}

impl Table {
    pub(crate) fn new(columns: &[&str]) -> Self {
        let rule: String = columns.iter().skip(1).map(|_| " ---: |").collect();
        Self { text: format!("| {} |\n| --- |{rule}\n", columns.join(" | ")) }
    }

    pub(crate) fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        let cells: Vec<_> = cells.into_iter().collect();
        self.text += &format!("| {} |\n", cells.join(" | "));
    }
}

/// Middle value; of an even number the mean of the middle two; NaN of none.
pub(crate) fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    let at = |index: usize| sorted.get(index).copied().unwrap_or(f64::NAN);
    f64::midpoint(at(sorted.len().saturating_sub(1) / 2), at(sorted.len() / 2))
}

/// Largest value; NaN of none.
pub(crate) fn worst(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(f64::NAN, f64::max)
}

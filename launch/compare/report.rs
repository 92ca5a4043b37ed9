//! What a comparison came to: table, JSON and picture.

use std::fmt::Write as _;
use std::path::Path;

use evac_formats::{FormatError, write_atomically};
use evac_picture::{LineChart, Panel, Series, Stroke, line_chart};
use serde::Serialize;

/// One side.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Side {
    /// Kind of stage, with the instance's number where it runs.
    pub(super) name: String,
    pub(super) pid: Option<u32>,
    /// Share of a core, percent.
    pub(super) cpu_percent: Option<f64>,
    /// Frames that came from it.
    pub(super) frames: u64,
}

/// What the deviation of a frame is measured in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(super) struct Measures {
    /// Name with unit, as in the JSON.
    pub(super) keys: [&'static str; 2],
    /// Name with unit, for people.
    pub(super) labels: [&'static str; 2],
}

/// One frame that both have.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Row {
    pub(super) seq: u64,
    /// Since the first one, seconds.
    pub(super) time_s: f64,
    pub(super) deviation: [f64; 2],
    /// Of each side, milliseconds.
    pub(super) latency_ms: [f64; 2],
}

/// A comparison.
#[derive(Debug, Serialize)]
pub(super) struct Comparison {
    pub(super) about: String,
    pub(super) sides: [Side; 2],
    pub(super) measures: Measures,
    /// What the latency is from and to.
    pub(super) latency: &'static str,
    /// Frames that one side only has put out.
    pub(super) unmatched: u64,
    pub(super) rows: Vec<Row>,
}

/// Of a series.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct Spread {
    median: f64,
    p95: f64,
    max: f64,
    last: f64,
}

impl Spread {
    /// `None` without values.
    fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<_> = values.collect();
        let last = *values.last()?;
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values.get(((values.len() - 1) as f64 * share).round() as usize).copied();
        Some(Self { median: at(0.5)?, p95: at(0.95)?, max: at(1.0)?, last })
    }
}

impl Comparison {
    pub(super) fn table(&self) -> String {
        let [a, b] = &self.sides;
        let mut text = format!(
            "{}: {} beside {}; {} frames of both, {} of one only\n{:<36} {:>10} {:>10} {:>10} {:>10}\n",
            self.about,
            a.name,
            b.name,
            self.rows.len(),
            self.unmatched,
            "",
            "median",
            "95 %",
            "max",
            "last"
        );
        let mut line = |label: &str, spread: Option<Spread>| {
            let Some(Spread { median, p95, max, last }) = spread else { return };
            // Writing to a String cannot fail.
            let _ = writeln!(text, "{label:<36} {median:>10.3} {p95:>10.3} {max:>10.3} {last:>10.3}");
        };
        for (index, label) in self.measures.labels.iter().enumerate() {
            line(label, self.spread(|row| row.deviation.get(index).copied()));
        }
        for (index, side) in self.sides.iter().enumerate() {
            let spread = self.spread(|row| row.latency_ms.get(index).copied());
            line(&format!("{} (ms), {}", self.latency, side.name), spread);
        }
        for side in &self.sides {
            if let Some(cpu) = side.cpu_percent {
                let _ = writeln!(text, "{:<36} {cpu:>10.1}", format!("CPU (%), {}", side.name));
            }
        }
        text
    }

    fn spread(&self, value: impl Fn(&Row) -> Option<f64>) -> Option<Spread> {
        Spread::of(self.rows.iter().filter_map(value))
    }

    pub(super) fn json(&self) -> serde_json::Value {
        let [first, second] = self.measures.keys;
        let deviation = |index: usize| self.spread(|row| row.deviation.get(index).copied());
        let latency = |index: usize| self.spread(|row| row.latency_ms.get(index).copied());
        serde_json::json!({
            "about": self.about,
            "a": self.sides[0],
            "b": self.sides[1],
            "frames": self.rows.len(),
            "unmatched": self.unmatched,
            "deviation": { first: deviation(0), second: deviation(1) },
            "latency": { "what": self.latency, "a_ms": latency(0), "b_ms": latency(1) },
            "columns": ["seq", "time_s", first, second, "a_latency_ms", "b_latency_ms"],
            "rows": self.rows.iter().map(|row| serde_json::json!([
                row.seq, row.time_s, row.deviation[0], row.deviation[1], row.latency_ms[0], row.latency_ms[1]
            ])).collect::<Vec<_>>(),
        })
    }

    /// Writes compare.json and compare.png.
    pub(super) fn write(&self, folder: &Path) -> Result<(), FormatError> {
        write_atomically(&folder.join("compare.json"), |writer| {
            serde_json::to_writer(&mut *writer, &self.json()).map_err(std::io::Error::from)?;
            std::io::Write::write_all(writer, b"\n")
        })?;
        let line = |name: String, stroke: usize, value: &dyn Fn(&Row) -> f64| {
            let points = self.rows.iter().map(|row| [row.time_s, value(row)]).collect();
            Series::line(name, Stroke::nth(stroke), points)
        };
        let panel = |label: String, series: Vec<Series>| Panel { y_label: label, series, ..Panel::default() };
        let [first, second] = self.measures.labels;
        let panels = vec![
            panel(first.to_owned(), vec![line(String::new(), 0, &|row| row.deviation[0])]),
            panel(second.to_owned(), vec![line(String::new(), 0, &|row| row.deviation[1])]),
            panel(
                format!("{} (ms)", self.latency),
                vec![
                    line(self.sides[0].name.clone(), 0, &|row| row.latency_ms[0]),
                    line(self.sides[1].name.clone(), 1, &|row| row.latency_ms[1]),
                ],
            ),
        ];
        let title = format!("{}: {} beside {}", self.about, self.sides[0].name, self.sides[1].name);
        let chart = LineChart { title, x_label: "time (s)".to_owned(), panels };
        line_chart(&folder.join("compare.png"), &chart)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_and_json_have_median_and_largest_of_what_was_measured() {
        let side = |name: &str| Side { name: name.to_owned(), cpu_percent: Some(7.5), ..Side::default() };
        let rows = (0..=100).map(|i| Row {
            seq: i,
            time_s: i as f64 * 0.1,
            deviation: [i as f64, 0.5],
            latency_ms: [2.0, 4.0],
        });
        let comparison = Comparison {
            about: "odometry".to_owned(),
            sides: [side("lio"), side("loam #1")],
            measures: Measures { keys: ["way_mm", "turn_deg"], labels: ["position (mm)", "rotation (deg)"] },
            latency: "end to end",
            unmatched: 3,
            rows: rows.collect(),
        };
        let table = comparison.table();
        for words in [
            "odometry: lio beside loam #1; 101 frames of both, 3 of one only",
            "position (mm)                            50.000     95.000    100.000    100.000",
            "CPU (%), lio                                7.5",
        ] {
            assert!(table.contains(words), "no '{words}' in\n{table}");
        }
        let json = comparison.json();
        assert_eq!(json["deviation"]["way_mm"]["max"], 100.0);
        assert_eq!(json["latency"]["b_ms"]["median"], 4.0);
        assert_eq!(json["rows"].as_array().map(Vec::len), Some(101));
    }
}

//! The minutes of a long walk, and whether they are alike.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use evac_formats::write_atomically;
use evac_frames::TrackingState;
use evac_picture::{LineChart, Panel, Series, Stroke, line_chart};
use serde::Serialize;

use super::process::ProcessFigures;
use crate::error::LaunchError;

/// Most memory that the odometry may hold, MB.
const MEMORY_LIMIT_MB: f64 = 120.0;
/// The last quarter's median time of a frame may be so much of the first quarter's.
const FLAT: f64 = 1.2;

/// One simulated minute.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Minute {
    minute: usize,
    /// From a deskewed scan's hand-over to its pose's: the odometry's time and one hop; median, milliseconds.
    median_ms: f64,
    /// The same, 99th percentile.
    p99_ms: f64,
    /// Mean of the time that the odometry's process computed for a frame, milliseconds.
    cpu_ms: f64,
    /// Its memory.
    process: ProcessFigures,
    /// Distance from the true position, first poses laid on each other, metres.
    drift_m: f64,
    /// Whether "lost" was said at the minute's end.
    lost: bool,
}

impl Minute {
    pub(super) fn new(
        minute: usize,
        times: &mut [f64],
        cpu_ms: f64,
        process: &ProcessFigures,
        drift_m: f64,
        state: u32,
    ) -> Self {
        times.sort_by(f64::total_cmp);
        Self {
            minute,
            median_ms: quantile(times, 0.5),
            p99_ms: quantile(times, 0.99),
            cpu_ms,
            process: *process,
            drift_m,
            lost: state == TrackingState::Lost as u32,
        }
    }

    /// Names of the columns of [`Self::line`].
    pub(super) fn head() -> &'static str {
        "minute  median ms   p99 ms   cpu ms  resident MB   peak MB    own MB  drift m"
    }

    pub(super) fn line(&self) -> String {
        format!(
            "{:>6} {:>10.2} {:>8.2} {:>8.2} {:>12.1} {:>9.1} {:>9.1} {:>8.3}{}",
            self.minute,
            self.median_ms,
            self.p99_ms,
            self.cpu_ms,
            self.process.resident_mb,
            self.process.peak_mb,
            self.process.own_mb,
            self.drift_m,
            if self.lost { "  lost" } else { "" }
        )
    }
}

/// The whole walk.
#[derive(Debug, Serialize)]
pub(super) struct Soak {
    evac: &'static str,
    world: String,
    seed: u64,
    /// Median over the minutes of the first and the last quarter, milliseconds.
    first_quarter_ms: f64,
    /// See above.
    last_quarter_ms: f64,
    /// Most memory at any time, MB.
    peak_mb: f64,
    /// Whether the last quarter's frames take at most 1.2 times as long as the first's.
    flat: bool,
    /// Whether memory stayed within 120 MB.
    within_memory: bool,
    minutes: Vec<Minute>,
}

impl Soak {
    pub(super) fn of(world: &str, seed: u64, minutes: Vec<Minute>) -> Self {
        let quarter = minutes.len().div_ceil(4);
        let middle = |minutes: &mut dyn Iterator<Item = &Minute>| {
            let mut times: Vec<f64> = minutes.map(|minute| minute.median_ms).collect();
            times.sort_by(f64::total_cmp);
            quantile(&times, 0.5)
        };
        let first_quarter_ms = middle(&mut minutes.iter().take(quarter));
        let last_quarter_ms = middle(&mut minutes.iter().rev().take(quarter));
        let peak_mb = minutes.iter().map(|minute| minute.process.peak_mb).fold(0.0, f64::max);
        Self {
            evac: env!("CARGO_PKG_VERSION"),
            world: world.to_owned(),
            seed,
            first_quarter_ms,
            last_quarter_ms,
            peak_mb,
            flat: last_quarter_ms <= FLAT * first_quarter_ms,
            within_memory: peak_mb <= MEMORY_LIMIT_MB,
            minutes,
        }
    }

    /// The verdict in words.
    pub(super) fn verdict(&self) -> String {
        let word = |holds: bool| if holds { "holds" } else { "DOES NOT HOLD" };
        format!(
            "time a frame: {:.2} ms in the first quarter, {:.2} ms in the last; at most {FLAT} times as long: {}\n\
             memory: at most {:.1} MB; limit {MEMORY_LIMIT_MB} MB: {}",
            self.first_quarter_ms,
            self.last_quarter_ms,
            word(self.flat),
            self.peak_mb,
            word(self.within_memory)
        )
    }

    /// Writes `soak.json` and `soak.png`.
    pub(super) fn write(&self, folder: &Path) -> Result<[PathBuf; 2], LaunchError> {
        let [json, png] = ["soak.json", "soak.png"].map(|name| folder.join(name));
        let text = serde_json::to_string_pretty(self)
            .map_err(|cause| LaunchError::Path(format!("{}: {cause}", json.display())))?;
        write_atomically(&json, |writer| writeln!(writer, "{text}"))?;
        line_chart(&png, &self.chart())?;
        Ok([json, png])
    }

    fn chart(&self) -> LineChart {
        let series = |name: &str, colour: usize, of: fn(&Minute) -> f64| {
            let points = self.minutes.iter().map(|minute| [minute.minute as f64, of(minute)]).collect();
            Series::line(name, Stroke::nth(colour), points)
        };
        let panel = |y_label: &str, top: f64, series: Vec<Series>| Panel {
            y_label: y_label.to_owned(),
            y_range: Some([0.0, 1.1 * top]),
            min_span: 0.0,
            series,
        };
        let most = |least: f64, of: fn(&Minute) -> f64| self.minutes.iter().map(of).fold(least, f64::max);
        let time = panel(
            "time a frame (ms)",
            most(2.5, |minute| minute.median_ms.max(minute.cpu_ms)),
            vec![
                series("median", 0, |minute| minute.median_ms),
                series("computed (mean)", 2, |minute| minute.cpu_ms),
            ],
        );
        // Apart, because another process on a busy machine shows here first.
        let slowest = panel(
            "99th percentile (ms)",
            most(5.0, |minute| minute.p99_ms),
            vec![series("99th percentile", 1, |minute| minute.p99_ms)],
        );
        let limit = self.minutes.iter().map(|minute| [minute.minute as f64, MEMORY_LIMIT_MB]).collect();
        let memory = panel(
            "memory (MB)",
            most(MEMORY_LIMIT_MB, |minute| minute.process.resident_mb),
            vec![
                Series::line("limit", Stroke::truth(), limit),
                series("resident", 3, |minute| minute.process.resident_mb),
                series("of its own", 4, |minute| minute.process.own_mb),
            ],
        );
        LineChart {
            title: format!("Odometry over {} minutes of walking ({})", self.minutes.len(), self.world),
            x_label: "walked (minutes)".to_owned(),
            panels: vec![time, slowest, memory],
        }
    }
}

/// Value below which `share` of the sorted values lie.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let index = (sorted.len() as f64 * share) as usize;
    sorted.get(index.min(sorted.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
}

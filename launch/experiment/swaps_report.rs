//! Table and JSON of `evac experiment swaps`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use evac_formats::{FormatError, write_atomically};
use serde::Serialize;

/// One swap.
#[derive(Debug, Serialize)]
pub(super) struct Change {
    pub(super) stage: String,
    /// Kind of the instance that took over.
    pub(super) kind: String,
    /// From its start until it could, seconds.
    pub(super) ready_s: f64,
    /// From the word to the old one to that of the new one, milliseconds; nothing where the old one was killed.
    pub(super) handover_ms: Option<f64>,
    /// The newest pose's frame when the old one was killed, or when the new one led.
    pub(super) seq: u64,
}

/// A change of the odometry's instance, seen in its poses.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Cut {
    /// First frame of the new one.
    pub(super) seq: u64,
    /// How far the step to it is off the true one.
    pub(super) off_m: f64,
    pub(super) off_deg: f64,
}

/// A time without a pose.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Gap {
    /// The frame whose pose ended it.
    pub(super) seq: u64,
    pub(super) ms: f64,
}

/// All of a run.
#[derive(Debug, Default, Serialize)]
pub(super) struct Swaps {
    seed: u64,
    killed: bool,
    pub(super) changes: Vec<Change>,
    /// Poses heard.
    pub(super) frames: u64,
    /// Frames that a sink did not acknowledge, or acknowledged twice.
    pub(super) lost: u64,
    pub(super) doubled: u64,
    /// Frames that the stages themselves count as lost or late.
    pub(super) stages_lost: u64,
    /// Poses in trajectory.tum.
    pub(super) saved_poses: u64,
    pub(super) odometry_cuts: Vec<Cut>,
    /// How far any other step of the odometry is off the true one, at worst.
    pub(super) elsewhere_m: f64,
    /// Longest time between two poses; the period is 100 ms.
    pub(super) longest_gap_ms: f64,
    /// Gaps longer than 1.5 periods.
    pub(super) long_gaps: Vec<Gap>,
}

impl Swaps {
    pub(super) fn new(seed: u64, killed: bool) -> Self {
        Self { seed, killed, ..Self::default() }
    }

    pub(super) fn table(&self) -> String {
        let mut by_stage: BTreeMap<(&str, &str), Vec<&Change>> = BTreeMap::new();
        for change in &self.changes {
            by_stage.entry((&change.stage, &change.kind)).or_default().push(change);
        }
        let mut text = format!(
            "{:<16} {:<14} {:>6} {:>18} {:>22}\n",
            "stage", "new kind", "swaps", "ready s p50/max", "handed over ms p50/max"
        );
        // Writing to a String cannot fail.
        for ((stage, kind), changes) in by_stage {
            let ready = median_and_max(changes.iter().map(|change| change.ready_s));
            let handover = median_and_max(changes.iter().filter_map(|change| change.handover_ms));
            let _ = writeln!(text, "{stage:<16} {kind:<14} {:>6} {ready:>18} {handover:>22}", changes.len());
        }
        let mut off_mm: Vec<_> = self.odometry_cuts.iter().map(|cut| cut.off_m * 1e3).collect();
        off_mm.sort_by(f64::total_cmp);
        let worst_deg = self.odometry_cuts.iter().map(|cut| cut.off_deg).fold(0.0, f64::max);
        let how = if self.killed { "kills beside a standby" } else { "swaps" };
        let _ = write!(
            text,
            "{} {how}, {} frames: {} lost and {} doubled at the sinks, {} lost or late by the stages' own count, {} poses saved\n\
             {} cuts of the odometry: {:.1} mm off the true step in the median, at worst {:.1} mm and {worst_deg:.3} degrees \
             (any other step: {:.1} mm at worst); longest gap of the pose stream {:.0} ms",
            self.changes.len(),
            self.frames,
            self.lost,
            self.doubled,
            self.stages_lost,
            self.saved_poses,
            off_mm.len(),
            off_mm.get(off_mm.len() / 2).copied().unwrap_or_default(),
            off_mm.last().copied().unwrap_or_default(),
            self.elsewhere_m * 1e3,
            self.longest_gap_ms,
        );
        text
    }

    pub(super) fn write(&self, folder: &Path) -> Result<PathBuf, FormatError> {
        let path = folder.join("swaps.json");
        write_atomically(&path, |writer| {
            serde_json::to_writer_pretty(&mut *writer, self).map_err(std::io::Error::from)?;
            std::io::Write::write_all(writer, b"\n")
        })?;
        Ok(path)
    }
}

fn median_and_max(values: impl Iterator<Item = f64>) -> String {
    let mut values: Vec<_> = values.collect();
    values.sort_by(f64::total_cmp);
    match (values.get(values.len() / 2), values.last()) {
        (Some(median), Some(max)) => format!("{median:.1}/{max:.1}"),
        _ => "-".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_a_line_a_stage_and_kind_and_the_figures_of_the_run() {
        let change = |kind: &str, ready_s: f64, handover_ms| Change {
            stage: "odometry".to_owned(),
            kind: kind.to_owned(),
            ready_s,
            handover_ms,
            seq: 0,
        };
        let mut swaps = Swaps::new(1, false);
        swaps.changes =
            vec![change("loam", 3.0, Some(0.5)), change("lio", 2.0, Some(0.25)), change("loam", 4.0, None)];
        (swaps.frames, swaps.lost) = (600, 2);
        swaps.odometry_cuts =
            [0.001, 0.0123, 0.004].map(|off_m| Cut { seq: 7, off_m, off_deg: 0.1 }).to_vec();
        let table = swaps.table();
        for words in [
            "loam                2            4.0/4.0",
            "3 swaps, 600 frames: 2 lost and 0 doubled",
            "3 cuts of the odometry: 4.0 mm off the true step in the median, at worst 12.3 mm",
        ] {
            assert!(table.contains(words), "no '{words}' in\n{table}");
        }
    }
}

//! Table and JSON of `evac chaos`.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::Serialize;

use super::fault::Deed;
use super::monitor::Sink;
use super::resources::Resources;
use crate::incidents::Incident;

/// A fault and what came of it.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Fault {
    pub(super) stage: String,
    pub(super) deed: Deed,
    /// The newest scan when it was done.
    pub(super) at_frame: u64,
    /// Until every sink had a frame that was measured after it, seconds; for a swap from its request on.
    pub(super) whole_s: Option<f64>,
    /// What a shadow came to.
    pub(super) remark: Option<String>,
}

/// All of a run.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    pub(super) seed: u64,
    pub(super) minutes: f64,
    pub(super) frames: u64,
    pub(super) faults: Vec<Fault>,
    pub(super) incidents: Vec<Incident>,
    pub(super) sinks: BTreeMap<String, Sink>,
    pub(super) longest_scan_gap_ms: f64,
    pub(super) before: Resources,
    pub(super) after: Resources,
    /// About each minute, between two faults.
    pub(super) each_minute: Vec<Resources>,
    pub(super) map_equal: bool,
    /// What must not be; empty in a good run.
    pub(super) violations: Vec<String>,
}

impl Report {
    pub(super) fn table(&self) -> String {
        let mut rows: BTreeMap<(Deed, &str), Vec<f64>> = BTreeMap::new();
        for fault in &self.faults {
            rows.entry((fault.deed, &fault.stage)).or_default().extend(fault.whole_s);
        }
        let mut text = format!("{:<18} {:<14} {:>6} {:>20}\n", "fault", "stage", "times", "whole s p50/max");
        // Writing to a String cannot fail.
        for ((deed, stage), times) in &mut rows {
            times.sort_by(f64::total_cmp);
            let [p50, max] =
                [times.get(times.len() / 2), times.last()].map(|time| time.copied().unwrap_or(f64::NAN));
            let _ = writeln!(
                text,
                "{:<18} {stage:<14} {:>6} {:>20}",
                deed.name(),
                times.len(),
                format!("{p50:.2}/{max:.2}")
            );
        }
        let mut back: Vec<_> = self
            .incidents
            .iter()
            .filter(|incident| !incident.cause.contains("hangs"))
            .filter_map(|incident| incident.resumed.as_ref())
            .map(|resumed| resumed.after_ms)
            .collect();
        back.sort_by(f64::total_cmp);
        let missing: u64 =
            self.incidents.iter().flat_map(Incident::missing).map(|(first, last)| last - first + 1).sum();
        let at =
            |share: usize| back.get(back.len().saturating_sub(1) * share / 100).copied().unwrap_or(f64::NAN);
        let _ = writeln!(
            text,
            "{} faults in {:.1} minutes and {} frames; a killed stage put out its next frame after {:.0} ms in the median, {:.0} ms at worst; \
             {missing} frames missing that the launcher stated",
            self.faults.len(),
            self.minutes,
            self.frames,
            at(50),
            at(100),
        );
        for (name, sink) in &self.sinks {
            let lost: u64 = sink.gaps.iter().map(|(first, last)| last - first + 1).sum();
            let _ = writeln!(
                text,
                "{name}: {} frames, {lost} missing in {} gaps, {} doubled, {} done again by an instance that took over",
                sink.frames,
                sink.gaps.len(),
                sink.doubled,
                sink.again
            );
        }
        let _ = writeln!(
            text,
            "longest time between two scans of one simulator: {:.0} ms",
            self.longest_scan_gap_ms
        );
        self.write_held(&mut text);
        let equal = if self.map_equal {
            "is the mapper's map, byte for byte"
        } else {
            "DIFFERS from the mapper's map"
        };
        let _ = writeln!(text, "map.ot of the saver {equal}");
        if self.violations.is_empty() {
            text += "nothing happened that must not";
        }
        for violation in &self.violations {
            let _ = writeln!(text, "VIOLATED: {violation}");
        }
        text
    }

    fn write_held(&self, text: &mut String) {
        let (a, b) = (&self.before, &self.after);
        let (before, after) = (format!("after {:.0} s", a.at_s), format!("after {:.0} s", b.at_s));
        let _ = writeln!(text, "{:<28} {before:>14} {after:>14}", "held, all stages swapped");
        let mut line = |name: &str, before: f64, after: f64| {
            let _ = writeln!(text, "{name:<28} {before:>14.1} {after:>14.1}");
        };
        line("shared memory, files", a.shared_files as f64, b.shared_files as f64);
        line("shared memory, MiB", a.shared_mib, b.shared_mib);
        line("domain's folder, entries", a.folder_entries as f64, b.folder_entries as f64);
        line("map.ot, MiB", a.saved_map_mib, b.saved_map_mib);
        let launcher = ("launcher".to_owned(), [a.launcher, b.launcher]);
        let stages = a
            .stages
            .iter()
            .map(|(name, held)| (name.clone(), [*held, b.stages.get(name).copied().unwrap_or_default()]));
        for (name, [before, after]) in std::iter::once(launcher).chain(stages) {
            let [x, y] = [before, after].map(|held| held.descriptors as f64);
            line(&format!("{name}, descriptors"), x, y);
            line(&format!("{name}, own MiB"), before.anonymous_mib, after.anonymous_mib);
        }
    }
}

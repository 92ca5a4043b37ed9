//! What the processes of a pipeline hold at one moment, and what of it has grown that must not.
//!
//! Two moments can be compared where every process is equally old: just before each, all stages were swapped once (`run.rs`). Descriptors
//! and files are the same to a few then. A process that has met two instances of another holds more than one that has met one, and a
//! reader lets go of a dead writer's memory only when it next reads; so at other moments what is held swings.

use std::collections::BTreeMap;
use std::path::Path;

use evac_ports::Domain;
use serde::Serialize;

use crate::supervisor::Supervisor;

/// What one process holds.
#[derive(Debug, Default, Clone, Copy, Serialize)]
pub(super) struct Held {
    pub(super) descriptors: usize,
    /// Memory of its own; pages of shared memory and of executables are not in it.
    pub(super) anonymous_mib: f64,
}

/// What all hold.
#[derive(Debug, Default, Clone, Serialize)]
pub(super) struct Resources {
    /// Since the beginning, seconds.
    pub(super) at_s: f64,
    /// Of the domain and of its shadows'.
    pub(super) shared_files: usize,
    pub(super) shared_mib: f64,
    /// Entries of the domain's folder, registrations of the middleware included.
    pub(super) folder_entries: usize,
    pub(super) launcher: Held,
    /// Size of the newest `map.ot`: why the stages that hold the map have grown, if they have.
    pub(super) saved_map_mib: f64,
    /// By name; two instances of one stage are added up.
    pub(super) stages: BTreeMap<String, Held>,
}

impl Resources {
    pub(super) fn of(supervisor: &Supervisor, domain: &Domain) -> Self {
        let mut now =
            Self { launcher: Held::of("self"), folder_entries: entries(&domain.folder()), ..Self::default() };
        for domain in [Some(domain.clone()), domain.of_shadows().ok()].into_iter().flatten() {
            let (files, bytes) = domain.shared_memory();
            now.shared_files += files;
            now.shared_mib += bytes as f64 / f64::from(1 << 20);
        }
        for child in supervisor.children.iter().filter(|child| child.ended.is_none()) {
            let held = Held::of(&child.pid().to_string());
            let all = now.stages.entry(child.name.clone()).or_default();
            all.descriptors += held.descriptors;
            all.anonymous_mib += held.anonymous_mib;
        }
        now
    }

    pub(super) fn stage_descriptors(&self) -> usize {
        self.stages.values().map(|held| held.descriptors).sum()
    }

    pub(super) fn stage_mib(&self) -> f64 {
        self.stages.values().map(|held| held.anonymous_mib).sum()
    }

    /// What has grown that must not.
    pub(super) fn leaks(&self, before: &Self) -> Vec<String> {
        let grown = |what: &str, before: f64, now: f64, allowed: f64| {
            (now > before + allowed).then(|| format!("{what}: {before:.1} before, {now:.1} after"))
        };
        let count = |what: &str, before: usize, now: usize, allowed: usize| {
            grown(what, before as f64, now as f64, allowed as f64)
        };
        [
            count("files in shared memory", before.shared_files, self.shared_files, 12),
            // Map updates and snapshots are as large as what they say.
            grown("MiB of shared memory", before.shared_mib, self.shared_mib, 32.0),
            count("entries of the domain's folder", before.folder_entries, self.folder_entries, 24),
            count("descriptors of the launcher", before.launcher.descriptors, self.launcher.descriptors, 6),
            count("descriptors of the stages", before.stage_descriptors(), self.stage_descriptors(), 24),
            grown("MiB of the launcher", before.launcher.anonymous_mib, self.launcher.anonymous_mib, 4.0),
            // Map, cloud and trajectories grow while the walk sees new places, and a little while it sees the old ones again.
            grown("MiB of the stages", before.stage_mib(), self.stage_mib(), 64.0),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

impl Held {
    fn of(pid: &str) -> Self {
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
        let kib = status.lines().find_map(|line| line.strip_prefix("RssAnon:"));
        let kib = kib.and_then(|value| value.split_whitespace().next()?.parse().ok()).unwrap_or(0_u64);
        Self {
            descriptors: std::fs::read_dir(format!("/proc/{pid}/fd")).map_or(0, Iterator::count),
            anonymous_mib: kib as f64 / 1024.0,
        }
    }
}

fn entries(folder: &Path) -> usize {
    let inside = std::fs::read_dir(folder).into_iter().flatten().flatten();
    inside.map(|entry| 1 + if entry.path().is_dir() { entries(&entry.path()) } else { 0 }).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_grown_beyond_what_it_may_is_named_with_both_figures() {
        let held = |descriptors, anonymous_mib| Held { descriptors, anonymous_mib };
        let at = |launcher, stage| Resources {
            launcher,
            stages: BTreeMap::from([("lio".to_owned(), stage)]),
            ..Resources::default()
        };
        let before = at(held(100, 7.0), held(110, 12.0));
        assert_eq!(at(held(102, 7.5), held(112, 14.0)).leaks(&before), Vec::<String>::new());
        assert_eq!(
            at(held(125, 7.5), held(112, 90.0)).leaks(&before),
            [
                "descriptors of the launcher: 100.0 before, 125.0 after",
                "MiB of the stages: 12.0 before, 90.0 after"
            ]
        );
    }

    #[test]
    fn a_descriptor_and_memory_of_this_process_are_counted() {
        let before = Held::of("self");
        let files: Vec<_> = (0..50).map(|_| std::fs::File::open("/proc/self/status")).collect();
        let pages = std::hint::black_box(vec![1_u8; 64 << 20]);
        let now = Held::of("self");
        assert!(now.descriptors >= before.descriptors + 40, "{before:?} {now:?}");
        assert!(now.anonymous_mib > before.anonymous_mib + 50.0, "{before:?} {now:?}");
        drop((files, pages));
    }
}

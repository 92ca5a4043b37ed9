//! What must not happen, seen from outside: frames lost or doubled at the sinks, a producer that stalls, something that leaks.

use std::collections::BTreeMap;

use evac_frames::{Ack, Health};
use evac_ports::services::{LidarScan, SinkAck};
use evac_ports::{Bus, Domain, FrameSubscriber, PortError, RecordSubscriber};
use serde::Serialize;

use crate::incidents::Incident;
use crate::supervisor::Supervisor;

/// A producer that says nothing for longer than this stalls, milliseconds; its period is 100 in real time.
pub(super) const STALL_MS: f64 = 1500.0;

/// Follows the producer and the sinks.
#[derive(Debug)]
pub(super) struct Monitor {
    scans: FrameSubscriber<LidarScan>,
    acks: RecordSubscriber<SinkAck>,
    pub(super) seen: Seen,
}

/// What was seen.
#[derive(Debug, Default)]
pub(super) struct Seen {
    /// Newest scan: number, writer, hand-over.
    scan: Option<(u64, u32, i64)>,
    /// Longest time between two scans of one instance, milliseconds.
    pub(super) longest_gap_ms: f64,
    pub(super) sinks: BTreeMap<String, Sink>,
}

/// One sink.
#[derive(Debug, Default, Clone, Serialize)]
pub(super) struct Sink {
    pub(super) frames: u64,
    next: u64,
    epoch: u32,
    /// First and last frame of each.
    pub(super) gaps: Vec<(u64, u64)>,
    /// Acknowledged twice by one instance.
    pub(super) doubled: u64,
    /// Acknowledged once more by an instance that took the place of a dead one.
    pub(super) again: u64,
}

impl Monitor {
    pub(super) fn open(bus: &Bus) -> Result<Self, PortError> {
        let (scans, acks) = (FrameSubscriber::open(bus)?.0, RecordSubscriber::open(bus)?.0);
        Ok(Self { scans, acks, seen: Seen::default() })
    }

    pub(super) fn take_in(&mut self) -> Result<(), PortError> {
        while let Some(scan) = self.scans.receive()? {
            let frame = &scan.header().frame;
            self.seen.take_scan(frame.seq, frame.epoch, frame.sent_ns);
        }
        while let Some(ack) = self.acks.receive()? {
            self.seen.take_ack(&ack);
        }
        Ok(())
    }
}

impl Seen {
    fn take_scan(&mut self, seq: u64, epoch: u32, sent_ns: i64) {
        if let Some((_, before, then_ns)) = self.scan
            && before == epoch
        {
            self.longest_gap_ms = self.longest_gap_ms.max((sent_ns - then_ns) as f64 * 1e-6);
        }
        self.scan = Some((seq, epoch, sent_ns));
    }

    fn take_ack(&mut self, ack: &Ack) {
        let fresh = Sink { next: ack.seq, epoch: ack.epoch, ..Sink::default() };
        let sink = self.sinks.entry(Health::text_of(&ack.name)).or_insert(fresh);
        if ack.seq > sink.next {
            sink.gaps.push((sink.next, ack.seq - 1));
        }
        if ack.seq < sink.next {
            sink.again += u64::from(ack.epoch > 0);
            sink.doubled += u64::from(ack.epoch == sink.epoch && ack.epoch == 0);
        } else {
            sink.frames += 1;
        }
        (sink.next, sink.epoch) = (ack.seq.saturating_add(1).max(sink.next), ack.epoch);
    }

    /// Number of the newest scan.
    pub(super) fn newest(&self) -> u64 {
        self.scan.map_or(0, |(seq, ..)| seq)
    }

    /// How far all sinks are.
    pub(super) fn acked(&self) -> u64 {
        self.sinks.values().map(|sink| sink.next).min().unwrap_or(0)
    }

    /// Frames that a sink does not have and no incident states.
    pub(super) fn unexplained(&self, incidents: &[Incident]) -> Vec<String> {
        let stated: Vec<_> = incidents.iter().filter_map(Incident::missing).collect();
        let is_stated = |seq: u64| stated.iter().any(|(first, last)| (*first..=*last).contains(&seq));
        let mut found = Vec::new();
        for (name, sink) in &self.sinks {
            for (first, last) in &sink.gaps {
                let missing: Vec<_> = (*first..=*last).filter(|seq| !is_stated(*seq)).collect();
                if let (Some(first), Some(last)) = (missing.first(), missing.last()) {
                    found.push(format!("{name} does not have frames {first} to {last} ({})", missing.len()));
                }
            }
        }
        found
    }
}

/// What the processes hold at one moment.
#[derive(Debug, Default, Clone, Copy, Serialize)]
pub(super) struct Resources {
    pub(super) shared_files: usize,
    pub(super) shared_mib: f64,
    pub(super) launcher_fds: usize,
    pub(super) launcher_mib: f64,
    pub(super) stage_fds: usize,
    pub(super) stage_mib: f64,
    /// Entries of the domain's folder, registrations of the middleware included.
    pub(super) folder_entries: usize,
}

impl Resources {
    pub(super) fn of(supervisor: &Supervisor, domain: &Domain) -> Self {
        let (files, bytes) = domain.shared_memory();
        let mib = |kib: u64| kib as f64 / 1024.0;
        let mut now = Self {
            shared_files: files,
            shared_mib: bytes as f64 / f64::from(1 << 20),
            launcher_fds: descriptors("self"),
            launcher_mib: mib(own_kib("self")),
            folder_entries: entries(&domain.folder()),
            ..Self::default()
        };
        for child in supervisor.children.iter().filter(|child| child.ended.is_none()) {
            let pid = child.pid().to_string();
            now.stage_fds += descriptors(&pid);
            now.stage_mib += mib(own_kib(&pid));
        }
        now
    }
}

impl Resources {
    /// What has grown that must not.
    pub(super) fn leaks(&self, before: &Self) -> Vec<String> {
        let grown = |what: &str, before: f64, now: f64, allowed: f64| {
            (now > before + allowed).then(|| format!("{what}: {before:.1} before, {now:.1} after"))
        };
        // A reader lets go of a dead writer's memory when it next reads, so what is held swings by some connections.
        [
            grown("files in shared memory", before.shared_files as f64, self.shared_files as f64, 24.0),
            grown("descriptors of the launcher", before.launcher_fds as f64, self.launcher_fds as f64, 40.0),
            grown("descriptors of the stages", before.stage_fds as f64, self.stage_fds as f64, 200.0),
            grown("MiB of the launcher", before.launcher_mib, self.launcher_mib, 32.0),
            // The map grows while the walk sees new places; each instance begins with the whole of it.
            grown("MiB of the stages", before.stage_mib, self.stage_mib, 192.0),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

fn descriptors(pid: &str) -> usize {
    std::fs::read_dir(format!("/proc/{pid}/fd")).map_or(0, Iterator::count)
}

/// Memory that is a process's own, KiB; what is shared is counted once, above.
fn own_kib(pid: &str) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let value = status.lines().find_map(|line| line.strip_prefix("RssAnon:"));
    value.and_then(|value| value.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

fn entries(folder: &std::path::Path) -> usize {
    let inside = std::fs::read_dir(folder).into_iter().flatten().flatten();
    inside.map(|entry| 1 + if entry.path().is_dir() { entries(&entry.path()) } else { 0 }).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_at_a_sink_that_no_incident_states_is_found_with_its_frames() {
        let mut seen = Seen::default();
        for seq in [3, 4, 8, 9] {
            seen.take_ack(&Ack { name: Health::text("saver"), seq, ..Ack::default() });
        }
        assert_eq!(seen.sinks["saver"].gaps, [(5, 7)]);
        assert!(seen.unexplained(&[])[0].contains("5 to 7"));
        let mut incidents = crate::incidents::Incidents::default();
        incidents.add(Incident::new("lio", 0, String::new(), false, Some(4)));
        incidents.resumed("lio", crate::pulse::Beat { seq: 8, sent_ns: 0 });
        assert_eq!(seen.unexplained(&incidents.newest), Vec::<String>::new());
    }
}

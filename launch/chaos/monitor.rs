//! What must not happen, seen from outside: frames lost or doubled at the sinks, a producer that stalls.

use std::collections::BTreeMap;

use evac_frames::{Ack, Health};
use evac_ports::services::{LidarScan, SinkAck};
use evac_ports::{Bus, FrameSubscriber, PortError, RecordSubscriber};
use serde::Serialize;

use crate::incidents::Incident;

/// A producer that says nothing for longer than this stalls, milliseconds; its period is 100 in real time. One that waited for a stopped
/// reader would from its 32nd frame to the 60th (`HANG_FRAMES`), 2.8 s.
pub(crate) const STALL_MS: f64 = 2500.0;

/// Follows the producer and the sinks.
#[derive(Debug)]
pub(crate) struct Monitor {
    scans: FrameSubscriber<LidarScan>,
    acks: RecordSubscriber<SinkAck>,
    pub(crate) seen: Seen,
}

/// What was seen.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    /// Newest scan: number, writer, hand-over.
    scan: Option<(u64, u32, i64)>,
    /// Longest time between two scans of one instance, milliseconds.
    pub(crate) longest_gap_ms: f64,
    pub(crate) sinks: BTreeMap<String, Sink>,
}

/// One sink.
#[derive(Debug, Default, Clone, Serialize)]
pub(crate) struct Sink {
    pub(crate) frames: u64,
    next: u64,
    /// Newest frame of each instance.
    #[serde(skip)]
    newest: BTreeMap<u32, u64>,
    /// First and last frame of each.
    pub(crate) gaps: Vec<(u64, u64)>,
    /// Acknowledged twice by one instance.
    pub(crate) doubled: u64,
    /// Acknowledged once more by an instance that took the place of a dead one.
    pub(crate) again: u64,
}

impl Monitor {
    pub(crate) fn open(bus: &Bus) -> Result<Self, PortError> {
        let (scans, acks) = (FrameSubscriber::open(bus)?.0, RecordSubscriber::open(bus)?.0);
        Ok(Self { scans, acks, seen: Seen::default() })
    }

    pub(crate) fn take_in(&mut self) -> Result<(), PortError> {
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
        let fresh = Sink { next: ack.seq, ..Sink::default() };
        let sink = self.sinks.entry(Health::text_of(&ack.name)).or_insert(fresh);
        if ack.seq > sink.next {
            sink.gaps.push((sink.next, ack.seq - 1));
        }
        let newest = sink.newest.insert(ack.epoch, ack.seq);
        if newest.is_some_and(|newest| ack.seq <= newest) {
            sink.doubled += 1;
        } else if ack.seq < sink.next {
            sink.again += 1;
        } else {
            sink.frames += 1;
        }
        sink.next = sink.next.max(ack.seq.saturating_add(1));
    }

    /// Number of the newest scan.
    pub(crate) fn newest(&self) -> u64 {
        self.scan.map_or(0, |(seq, ..)| seq)
    }

    /// How far all sinks are.
    pub(crate) fn acked(&self) -> u64 {
        self.sinks.values().map(|sink| sink.next).min().unwrap_or(0)
    }

    /// Frames that a sink does not have and no incident states.
    pub(crate) fn unexplained(&self, incidents: &[Incident]) -> Vec<String> {
        let stated: Vec<_> = incidents.iter().flat_map(Incident::missing).collect();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::Resumption;

    #[test]
    fn what_one_instance_says_twice_is_doubled_and_what_the_next_says_again_is_not() {
        let mut seen = Seen::default();
        for (epoch, seq) in [(0, 3), (0, 4), (2, 3), (2, 4), (0, 5), (2, 5), (2, 6), (2, 6), (2, 5), (2, 7)] {
            seen.take_ack(&Ack { name: Health::text("saver"), epoch, seq, ..Ack::default() });
        }
        let Sink { frames, again, doubled, .. } = &seen.sinks["saver"];
        assert_eq!((*frames, *again, *doubled), (5, 3, 2));
    }

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
        assert!(seen.unexplained(&incidents.newest)[0].contains("5 to 7"));
        let first = Some(crate::pulse::Beat { seq: 8, sent_ns: 0 });
        incidents.resumed("lio", Resumption { first, repeated: 0, missing: vec![(5, 7)] });
        assert_eq!(seen.unexplained(&incidents.newest), Vec::<String>::new());
    }
}

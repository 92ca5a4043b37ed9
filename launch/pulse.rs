//! How far every stage is, frame by frame, heard on the services themselves: a process that hangs says nothing of itself.

use std::collections::BTreeMap;

use evac_frames::{FrameHeader, Health, frame_flags};
use evac_ports::services::FrameService;
use evac_ports::services::{LidarScan, MapUpdate, OdometryPose, RecordService as _, ScanDeskewed, SinkAck};
use evac_ports::{Bus, FrameSubscriber, PortError, RecordSubscriber, now_ns};

use crate::registry::kind;
use crate::slot::Slot;

/// Whose frames: a service's, or those that a sink acknowledges.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Line {
    Service(&'static str),
    Sink([u8; 24]),
}

/// What is waited for: how an instance newer than `epoch` goes on after frame `after`, the last of the one before.
#[derive(Debug)]
struct Wanted {
    line: Line,
    epoch: u32,
    after: Option<u64>,
    resumption: Resumption,
    /// The instance has put out something.
    heard: bool,
    /// Nothing is open any more.
    settled: bool,
}

/// How a stage goes on after a death.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Resumption {
    /// The first frame that is new.
    pub(crate) first: Option<Beat>,
    /// Frames put out before it that the dead instance had put out, too.
    pub(crate) repeated: u64,
    /// First and last of those that nobody put out.
    pub(crate) missing: Vec<(u64, u64)>,
}

/// A frame that was put out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Beat {
    pub(crate) seq: u64,
    /// Host monotonic time.
    pub(crate) sent_ns: i64,
}

/// Listens to the services that stages write.
#[derive(Debug)]
pub(crate) struct Pulse {
    scans: FrameSubscriber<LidarScan>,
    deskewed: FrameSubscriber<ScanDeskewed>,
    poses: RecordSubscriber<OdometryPose>,
    updates: FrameSubscriber<MapUpdate>,
    acks: RecordSubscriber<SinkAck>,
    heard: Heard,
}

#[derive(Debug, Default)]
struct Heard {
    /// Newest frame of each instance.
    newest: BTreeMap<(Line, u32), u64>,
    wanted: Vec<Wanted>,
}

impl Wanted {
    fn new(line: Line, epoch: u32, after: Option<u64>) -> Self {
        Self { line, epoch, after, resumption: Resumption::default(), heard: false, settled: false }
    }

    /// A sink's first word may be about a frame that the dead one was done with and had not said so: then the second tells what is
    /// missing.
    fn take(&mut self, frame: &FrameHeader) {
        if self.settled || frame.epoch <= self.epoch {
            return;
        }
        let is_first_word = !std::mem::replace(&mut self.heard, true);
        if self.after.is_some_and(|after| frame.seq <= after) {
            self.resumption.repeated += 1;
            return;
        }
        let newest = self.resumption.first.map(|first| first.seq);
        if newest.is_some_and(|newest| frame.seq <= newest) {
            return;
        }
        let next = newest.or(self.after).map_or(0, |seq| seq.saturating_add(1));
        if frame.seq > next {
            self.resumption.missing.push((next, frame.seq - 1));
        }
        self.resumption.first.get_or_insert(Beat { seq: frame.seq, sent_ns: frame.sent_ns });
        let may_be_the_dead_ones = is_first_word && matches!(self.line, Line::Sink(_));
        self.settled = !may_be_the_dead_ones || frame.flags & frame_flags::END_OF_STREAM != 0;
    }
}

impl Heard {
    fn take(&mut self, line: Line, frame: &FrameHeader) {
        self.wanted.iter_mut().filter(|wanted| wanted.line == line).for_each(|wanted| wanted.take(frame));
        let newest = self.newest.entry((line, frame.epoch)).or_insert(frame.seq);
        *newest = frame.seq.max(*newest);
    }
}

impl Pulse {
    pub(crate) fn open(bus: &Bus) -> Result<Self, PortError> {
        Ok(Self {
            scans: FrameSubscriber::open(bus)?.0,
            deskewed: FrameSubscriber::open(bus)?.0,
            poses: RecordSubscriber::open(bus)?.0,
            updates: FrameSubscriber::open(bus)?.0,
            acks: RecordSubscriber::open(bus)?.0,
            heard: Heard::default(),
        })
    }

    /// Takes everything that has come. What is put out last in a frame's way is taken first: of its partners nothing is missed then.
    pub(crate) fn take_in(&mut self) -> Result<(), PortError> {
        let heard = &mut self.heard;
        while let Some(ack) = self.acks.receive()? {
            let flags = if ack.finished != 0 { frame_flags::END_OF_STREAM } else { 0 };
            let (seq, epoch, sent_ns) = (ack.seq, ack.epoch, now_ns());
            let frame = FrameHeader { seq, epoch, sent_ns, flags, ..FrameHeader::default() };
            heard.take(Line::Sink(ack.name), &frame);
        }
        drain(&self.updates, heard, |header| &header.frame)?;
        while let Some(pose) = self.poses.receive()? {
            heard.take(Line::Service(OdometryPose::NAME), &pose.frame);
        }
        drain(&self.deskewed, heard, |header| &header.frame)?;
        drain(&self.scans, heard, |header| &header.frame)
    }

    /// The newest frame of an instance.
    pub(crate) fn newest(&self, line: &Line, epoch: u32) -> Option<u64> {
        self.heard.newest.get(&(line.clone(), epoch)).copied()
    }

    /// Waits for the first frame after `after` of an instance newer than `epoch`.
    pub(crate) fn want(&mut self, line: Line, epoch: u32, after: Option<u64>) {
        self.heard.wanted.retain(|wanted| wanted.line != line);
        self.heard.wanted.push(Wanted::new(line, epoch, after));
    }

    /// How a stage that was waited for has gone on, once all is known of it.
    pub(crate) fn came(&mut self, line: &Line) -> Option<Resumption> {
        let at = self.heard.wanted.iter().position(|wanted| wanted.line == *line && wanted.settled)?;
        Some(self.heard.wanted.swap_remove(at).resumption)
    }

    /// As [`Self::came`], as far as it is known: the instance has died.
    pub(crate) fn came_so_far(&mut self, line: &Line) -> Option<Resumption> {
        let has_come = |wanted: &Wanted| wanted.line == *line && wanted.resumption.first.is_some();
        let at = self.heard.wanted.iter().position(has_come)?;
        Some(self.heard.wanted.swap_remove(at).resumption)
    }

    pub(crate) fn forget(&mut self, line: &Line, epoch: u32) {
        self.heard.newest.remove(&(line.clone(), epoch));
    }
}

fn drain<S: FrameService>(
    port: &FrameSubscriber<S>,
    heard: &mut Heard,
    frame: impl Fn(&S::Header) -> &FrameHeader,
) -> Result<(), PortError> {
    while let Some(sample) = port.receive()? {
        heard.take(Line::Service(S::NAME), frame(sample.header()));
    }
    Ok(())
}

/// Where a stage's progress is heard; nothing where it is not: an IMU alone, for example.
pub(crate) fn line_of(slot: &Slot) -> Option<Line> {
    let kind = kind(&slot.entry.kind).ok()?;
    let pulsed = [LidarScan::NAME, ScanDeskewed::NAME, OdometryPose::NAME, MapUpdate::NAME];
    if slot.role == crate::registry::Role::Consumer {
        return Some(Line::Sink(Health::text(slot.name())));
    }
    kind.writes.iter().find(|service| pulsed.contains(service)).map(|service| Line::Service(service))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beat(seq: u64) -> Option<Beat> {
        Some(Beat { seq, sent_ns: 0 })
    }

    fn heard(wanted: Wanted, frames: &[(u32, u64)]) -> Heard {
        let line = wanted.line.clone();
        let mut heard = Heard { wanted: vec![wanted], ..Heard::default() };
        for (epoch, seq) in frames {
            let frame = FrameHeader { seq: *seq, epoch: *epoch, ..FrameHeader::default() };
            heard.take(line.clone(), &frame);
        }
        heard
    }

    #[test]
    fn the_first_frame_after_a_crash_is_one_that_the_dead_instance_had_not_put_out() {
        let line = Line::Service(OdometryPose::NAME);
        let wanted = Wanted::new(line.clone(), 1, Some(7));
        let heard = heard(wanted, &[(1, 8), (2, 6), (2, 7), (2, 9), (2, 10)]);
        let expected = Resumption { first: beat(9), repeated: 2, missing: vec![(8, 8)] };
        assert!(heard.wanted[0].settled);
        assert_eq!(heard.wanted[0].resumption, expected);
        assert_eq!(heard.newest[&(line, 2)], 10);
    }

    #[test]
    fn a_sink_that_first_says_what_the_dead_one_had_written_down_is_known_by_its_second_word() {
        let sink = || Wanted::new(Line::Sink(Health::text("saver")), 0, Some(100));
        // The dead one had written down 101, but not said so; what comes next begins with the history.
        let open = heard(sink(), &[(1, 101)]);
        assert!(!open.wanted[0].settled);
        let gap = heard(sink(), &[(1, 101), (1, 120), (1, 121)]);
        assert!(gap.wanted[0].settled);
        let expected = Resumption { first: beat(101), repeated: 0, missing: vec![(102, 119)] };
        assert_eq!(gap.wanted[0].resumption, expected);
        // What it says again tells nothing; the first that is new tells all.
        let again = heard(sink(), &[(1, 99), (1, 100), (1, 101)]);
        assert!(again.wanted[0].settled);
        let expected = Resumption { first: beat(101), repeated: 2, missing: vec![] };
        assert_eq!(again.wanted[0].resumption, expected);
    }
}

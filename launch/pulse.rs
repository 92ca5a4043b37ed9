//! How far every stage is, frame by frame, heard on the services themselves: a process that hangs says nothing of itself.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use evac_config::Mode;
use evac_frames::{FrameHeader, Health};
use evac_ports::services::{FrameService, MapSnapshot};
use evac_ports::services::{LidarScan, MapUpdate, OdometryPose, RecordService as _, ScanDeskewed, SinkAck};
use evac_ports::{Bus, FrameSubscriber, PortError, RecordSubscriber, now_ns};

use crate::error::LaunchError;
use crate::registry::kind;
use crate::slot::Slot;

/// Lossless stages wait for each other, so that nobody's input goes on while one hangs: there a stage hangs that had work and did
/// nothing for so long. Half of what the source waits for its sinks.
const LOSSLESS_PATIENCE: Duration = Duration::from_secs(30);
/// Frames that come at once, from a stage that was started again, are no sign that their reader hangs: it has so long for the first.
const BURST: Duration = Duration::from_secs(1);

/// Whose frames: a service's, or those that a sink acknowledges.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Line {
    Service(&'static str),
    Sink([u8; 24]),
}

/// A frame that is waited for: the first after `after` of an instance newer than `epoch`.
#[derive(Debug)]
struct Wanted {
    line: Line,
    epoch: u32,
    after: Option<u64>,
    came: Option<Beat>,
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

impl Heard {
    fn take(&mut self, line: Line, frame: &FrameHeader) {
        for wanted in self.wanted.iter_mut().filter(|wanted| wanted.came.is_none() && wanted.line == line) {
            if frame.epoch > wanted.epoch && wanted.after.is_none_or(|after| frame.seq > after) {
                wanted.came = Some(Beat { seq: frame.seq, sent_ns: frame.sent_ns });
            }
        }
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
            let frame =
                FrameHeader { seq: ack.seq, epoch: ack.epoch, sent_ns: now_ns(), ..FrameHeader::default() };
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
        self.heard.wanted.push(Wanted { line, epoch, after, came: None });
    }

    /// A frame that was waited for and has come.
    pub(crate) fn came(&mut self, line: &Line) -> Option<Beat> {
        let at = self.heard.wanted.iter().position(|wanted| wanted.line == *line && wanted.came.is_some())?;
        self.heard.wanted.swap_remove(at).came
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

/// How a stage's frames compare with those of its inputs.
#[derive(Debug, Default)]
pub(crate) struct Watch {
    /// By slot.
    stages: Vec<Option<Stand>>,
}

#[derive(Debug, Clone, Copy)]
struct Stand {
    epoch: u32,
    own: Option<u64>,
    /// Newest input when it put out `own`, and when there was a newer one.
    base: u64,
    behind: Option<Instant>,
    input: u64,
    /// Nothing was put out or came in since.
    since: Instant,
}

impl Watch {
    /// The leading instances that hang, with the reason; to be asked after the pulse has taken everything in.
    pub(crate) fn hung(
        &mut self,
        slots: &[Slot],
        pulse: &Pulse,
        mode: Mode,
        after_frames: u64,
    ) -> Result<Vec<(usize, String)>, LaunchError> {
        self.stages.resize(slots.len(), None);
        let mut hung = Vec::new();
        for (index, slot) in slots.iter().enumerate() {
            let Some(line) = line_of(slot).filter(|_| after_frames > 0) else { continue };
            let Some(input) = newest_input(slot, slots, pulse)? else { continue };
            let own = pulse.newest(&line, slot.epoch);
            let now = Instant::now();
            let fresh = Stand { epoch: slot.epoch, own, base: input, behind: None, input, since: now };
            let Some(stand) = self.stages.get_mut(index) else { continue };
            let stand = stand.get_or_insert(fresh);
            if stand.epoch != slot.epoch || stand.own != own {
                *stand = fresh;
            } else if stand.input != input {
                (stand.input, stand.since) = (input, now);
                stand.behind = stand.behind.or(Some(now));
            }
            let missed = input.saturating_sub(stand.base);
            let last =
                own.map_or("it has put out nothing yet".to_owned(), |seq| format!("its last frame is {seq}"));
            let name = slot.name();
            if missed >= after_frames && stand.behind.is_some_and(|since| since.elapsed() >= BURST) {
                let text = format!(
                    "stage '{name}' hangs: {missed} more frames came to it and it put out none; {last}"
                );
                hung.push((index, text));
            } else if mode == Mode::Lossless
                && own.is_none_or(|own| own < input)
                && stand.since.elapsed() > LOSSLESS_PATIENCE
            {
                let seconds = LOSSLESS_PATIENCE.as_secs();
                let text = format!(
                    "stage '{name}' hangs: frames wait for it, and it put out none for {seconds} s; {last}"
                );
                hung.push((index, text));
            }
        }
        Ok(hung)
    }

    /// What an instance did before it was killed is no business of the next one's.
    pub(crate) fn forget(&mut self, slot: usize) {
        if let Some(stand) = self.stages.get_mut(slot) {
            *stand = None;
        }
    }
}

/// The newest frame that all inputs of a stage have; `None` while one has none, or where it has no input.
fn newest_input(slot: &Slot, slots: &[Slot], pulse: &Pulse) -> Result<Option<u64>, LaunchError> {
    let mut newest: Option<u64> = None;
    for service in kind(&slot.entry.kind)?.reads {
        // Of what follows from a stage's own output it may not be waited for: a deskewer's prior. A snapshot comes when asked for.
        let is_prior =
            *service == OdometryPose::NAME && kind(&slot.entry.kind)?.writes.contains(&ScanDeskewed::NAME);
        if is_prior || *service == MapSnapshot::NAME {
            continue;
        }
        let writer = slots.iter().find(|writer| line_of(writer) == Some(Line::Service(service)));
        let Some(writer) = writer else { continue };
        let Some(seq) = pulse.newest(&Line::Service(service), writer.epoch) else { return Ok(None) };
        newest = Some(newest.map_or(seq, |newest| newest.min(seq)));
    }
    Ok(newest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_frame_after_a_crash_is_one_that_the_dead_instance_had_not_put_out() {
        let mut heard = Heard::default();
        let line = Line::Service(OdometryPose::NAME);
        heard.wanted.push(Wanted { line: line.clone(), epoch: 1, after: Some(7), came: None });
        for (epoch, seq) in [(1, 8), (2, 6), (2, 7), (2, 9), (2, 10)] {
            heard.take(line.clone(), &FrameHeader { seq, epoch, ..FrameHeader::default() });
        }
        assert_eq!(heard.wanted[0].came, Some(Beat { seq: 9, sent_ns: 0 }));
        assert_eq!(heard.newest[&(line, 2)], 10);
    }
}

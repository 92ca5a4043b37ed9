//! What a standby sees of the routed instance: that instance's own output, frame by frame.

use std::collections::VecDeque;

use evac_frames::{Ack, Health, PoseFrame, Route};
use evac_ports::services::{OdometryPose, ScanDeskewed, SinkAck};
use evac_ports::{Bus, FrameSample, Listener, PortError, RecordSubscriber};

use crate::joins::gated::{GatedFrames, GatedRecords};
use crate::joins::map::{MapSample, MapStream};
use crate::{InputCounters, MapMessage, Reporter, StageError, StageOutput};

/// Outputs kept until the inputs of the same frame are complete. Input is behind by what the routed instance takes, if at all.
const MAX_AHEAD: usize = 16;

/// How far a standby is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Readiness {
    /// It could not take over with the next frame.
    Following,
    /// It could.
    Ready,
}

/// What the routed instance put out for one frame, as a stage of output `O` sees it.
pub type Routed<'a, O> = <<O as Followed>::Follower as Follower>::Routed<'a>;

/// An output that a standby can follow and go on with.
pub trait Followed: StageOutput {
    /// By what the routed instance's is read.
    type Follower: Follower;

    /// A standby takes note of what the routed instance put out.
    fn note(&mut self, _routed: &Routed<'_, Self>) {}

    /// Publishes the routed instance's newest output once more: one that was killed may have handed it to some of its readers only.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    fn repeat(&mut self, routed: Routed<'_, Self>) -> Result<(), StageError>;
}

/// Reads the routed instance's output.
pub trait Follower: Sized {
    /// The output for one frame.
    type Routed<'a>
    where
        Self: 'a;

    /// Opens the stage's own output for reading; `name` is the instance's.
    ///
    /// # Errors
    /// [`PortError`].
    fn open(bus: &Bus, name: &str) -> Result<(Self, Vec<Listener>), PortError>;

    /// Takes the launcher's word on which instance is listened to.
    fn route(&mut self, route: &Route);

    /// Takes everything that has come.
    ///
    /// # Errors
    /// [`PortError`].
    fn take_in(&mut self, reporter: &mut Reporter) -> Result<(), PortError>;

    /// Number of the first output that was not looked at yet, and whether it stands for itself: no input of the same
    /// frame belongs to it.
    fn front(&self) -> Option<(u64, bool)>;

    /// Looks at the first output and is done with it, but for [`Self::last`].
    fn pop(&mut self);

    /// The first output.
    fn first(&self) -> Option<Self::Routed<'_>>;

    /// The newest output that was looked at.
    fn last(&self) -> Option<Self::Routed<'_>>;
}

/// Outputs in order, and the newest that was looked at.
#[derive(Debug)]
struct Outputs<T> {
    ahead: VecDeque<T>,
    last: Option<T>,
}

impl<T> Outputs<T> {
    fn new() -> Self {
        Self { ahead: VecDeque::with_capacity(MAX_AHEAD + 1), last: None }
    }

    fn push(&mut self, output: T) {
        self.ahead.push_back(output);
        if self.ahead.len() > MAX_AHEAD {
            self.pop();
        }
    }

    fn pop(&mut self) {
        if let Some(output) = self.ahead.pop_front() {
            self.last = Some(output);
        }
    }
}

/// Follows a deskewer.
#[derive(Debug)]
pub struct ScanFollower {
    port: GatedFrames<ScanDeskewed>,
    outputs: Outputs<FrameSample<ScanDeskewed>>,
}

impl Follower for ScanFollower {
    type Routed<'a> = &'a FrameSample<ScanDeskewed>;

    fn open(bus: &Bus, _name: &str) -> Result<(Self, Vec<Listener>), PortError> {
        let (port, listener) = GatedFrames::open(bus)?;
        Ok((Self { port, outputs: Outputs::new() }, vec![listener]))
    }

    fn route(&mut self, route: &Route) {
        self.port.route(route);
    }

    fn take_in(&mut self, _reporter: &mut Reporter) -> Result<(), PortError> {
        while let Some(scan) = self.port.receive(&mut InputCounters::default())? {
            self.outputs.push(scan);
        }
        Ok(())
    }

    fn front(&self) -> Option<(u64, bool)> {
        self.outputs.ahead.front().map(|scan| (scan.header().frame.seq, false))
    }

    fn pop(&mut self) {
        self.outputs.pop();
    }

    fn first(&self) -> Option<&FrameSample<ScanDeskewed>> {
        self.outputs.ahead.front()
    }

    fn last(&self) -> Option<&FrameSample<ScanDeskewed>> {
        self.outputs.last.as_ref()
    }
}

/// Follows an odometry.
#[derive(Debug)]
pub struct PoseFollower {
    port: GatedRecords<OdometryPose>,
    outputs: Outputs<PoseFrame>,
}

impl Follower for PoseFollower {
    type Routed<'a> = &'a PoseFrame;

    fn open(bus: &Bus, _name: &str) -> Result<(Self, Vec<Listener>), PortError> {
        let (port, listener) = GatedRecords::open(bus)?;
        Ok((Self { port, outputs: Outputs::new() }, vec![listener]))
    }

    fn route(&mut self, route: &Route) {
        self.port.route(route);
    }

    fn take_in(&mut self, _reporter: &mut Reporter) -> Result<(), PortError> {
        while let Some(pose) = self.port.receive(&mut InputCounters::default())? {
            self.outputs.push(pose);
        }
        Ok(())
    }

    fn front(&self) -> Option<(u64, bool)> {
        self.outputs.ahead.front().map(|pose| (pose.frame.seq, false))
    }

    fn pop(&mut self) {
        self.outputs.pop();
    }

    fn first(&self) -> Option<&PoseFrame> {
        self.outputs.ahead.front()
    }

    fn last(&self) -> Option<&PoseFrame> {
        self.outputs.last.as_ref()
    }
}

/// Follows a mapper as any late joiner does: by a snapshot, which stands for itself, and the updates after it.
#[derive(Debug)]
pub struct MapFollower {
    stream: MapStream,
    outputs: Outputs<MapSample>,
}

impl Follower for MapFollower {
    type Routed<'a> = MapMessage<'a>;

    fn open(bus: &Bus, _name: &str) -> Result<(Self, Vec<Listener>), PortError> {
        let (stream, listeners) = MapStream::open(bus)?;
        Ok((Self { stream, outputs: Outputs::new() }, listeners.into()))
    }

    fn route(&mut self, route: &Route) {
        self.stream.route(route);
    }

    fn take_in(&mut self, reporter: &mut Reporter) -> Result<(), PortError> {
        self.stream.take_in(reporter)?;
        if self.outputs.ahead.is_empty()
            && let Some(message) = self.stream.next()
        {
            self.outputs.push(message);
        }
        Ok(())
    }

    fn front(&self) -> Option<(u64, bool)> {
        self.outputs.ahead.front().map(|message| (message.seq(), message.is_snapshot()))
    }

    fn pop(&mut self) {
        self.outputs.pop();
        // In the same breath: whether one is left says whether the routed instance was followed to its end.
        if let Some(message) = self.stream.next() {
            self.outputs.push(message);
        }
    }

    fn first(&self) -> Option<MapMessage<'_>> {
        self.outputs.ahead.front().map(MapSample::message)
    }

    fn last(&self) -> Option<MapMessage<'_>> {
        self.outputs.last.as_ref().map(MapSample::message)
    }
}

/// Follows a sink, of which nothing is heard but that it is done with a frame.
#[derive(Debug)]
pub struct AckFollower {
    port: RecordSubscriber<SinkAck>,
    name: [u8; 24],
    outputs: Outputs<Ack>,
}

impl Follower for AckFollower {
    type Routed<'a> = &'a Ack;

    fn open(bus: &Bus, name: &str) -> Result<(Self, Vec<Listener>), PortError> {
        let (port, listener) = RecordSubscriber::open(bus)?;
        Ok((Self { port, name: Health::text(name), outputs: Outputs::new() }, vec![listener]))
    }

    fn route(&mut self, _route: &Route) {}

    fn take_in(&mut self, _reporter: &mut Reporter) -> Result<(), PortError> {
        while let Some(ack) = self.port.receive()? {
            let newest = self.outputs.ahead.back().or(self.outputs.last.as_ref());
            if ack.name == self.name && newest.is_none_or(|newest| ack.seq > newest.seq) {
                self.outputs.push(ack);
            }
        }
        Ok(())
    }

    fn front(&self) -> Option<(u64, bool)> {
        self.outputs.ahead.front().map(|ack| (ack.seq, false))
    }

    fn pop(&mut self) {
        self.outputs.pop();
    }

    fn first(&self) -> Option<&Ack> {
        self.outputs.ahead.front()
    }

    fn last(&self) -> Option<&Ack> {
        self.outputs.last.as_ref()
    }
}

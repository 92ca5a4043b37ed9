//! The map's stream: updates without a gap, or a snapshot and the updates after it.

use std::collections::VecDeque;

use evac_frames::{MapHeader, Voxel, map_flags};
use evac_ports::services::{MapSnapshot, MapUpdate, SNAPSHOT_REQUEST};
use evac_ports::{Bus, FrameSample, FrameSubscriber, Listener, PortError, RequestSender};

use super::MAX_HELD;
use super::seq::SeqTracker;
use crate::{MapMessage, Reporter};

/// An update or a snapshot in shared memory.
#[derive(Debug)]
pub(super) enum MapSample {
    Update(FrameSample<MapUpdate>),
    Snapshot(FrameSample<MapSnapshot>),
}

impl MapSample {
    pub(super) fn header(&self) -> &MapHeader {
        match self {
            Self::Update(sample) => sample.header(),
            Self::Snapshot(sample) => sample.header(),
        }
    }

    pub(super) fn message(&self) -> MapMessage<'_> {
        let voxels: &[Voxel] = match self {
            Self::Update(sample) => sample.items(),
            Self::Snapshot(sample) => sample.items(),
        };
        MapMessage { header: self.header(), voxels }
    }

    pub(super) fn is_snapshot(&self) -> bool {
        self.header().map_flags & map_flags::SNAPSHOT != 0
    }
}

/// Reads the map's stream. A reader that joins late, or that missed an update, asks for a snapshot and goes on from it, so
/// that it always ends with the same map.
#[derive(Debug)]
pub(super) struct MapStream {
    updates: FrameSubscriber<MapUpdate>,
    snapshots: FrameSubscriber<MapSnapshot>,
    request: RequestSender,
    held: VecDeque<MapSample>,
    seq: SeqTracker,
    state: State,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// No update has come yet.
    Start,
    /// Every update up to here is known.
    InStep,
    /// A snapshot is asked for; updates are held.
    Asked,
}

impl MapStream {
    pub(super) fn open(bus: &Bus) -> Result<(Self, [Listener; 2]), PortError> {
        let (updates, update_listener) = FrameSubscriber::open(bus)?;
        let (snapshots, snapshot_listener) = FrameSubscriber::open(bus)?;
        let stream = Self {
            updates,
            snapshots,
            request: RequestSender::open(bus, SNAPSHOT_REQUEST)?,
            held: VecDeque::with_capacity(MAX_HELD + 2),
            seq: SeqTracker::default(),
            state: State::Start,
        };
        Ok((stream, [update_listener, snapshot_listener]))
    }

    pub(super) fn take_in(&mut self, reporter: &mut Reporter) -> Result<(), PortError> {
        while let Some(update) = self.updates.receive()? {
            let header = *update.header();
            reporter.received(header.frame.sent_ns);
            let Some(gap) = self.seq.gap(header.frame.seq) else { continue };
            reporter.input.lost += gap;
            let is_key_frame = header.map_flags & map_flags::KEY_FRAME != 0;
            let from_the_start = header.key_frames == u64::from(is_key_frame);
            let in_step = match self.state {
                State::Start => from_the_start,
                State::InStep => gap == 0,
                State::Asked => false,
            };
            if in_step {
                self.state = State::InStep;
            } else if self.state != State::Asked {
                self.request.send()?;
                self.state = State::Asked;
            }
            self.held.push_back(MapSample::Update(update));
            if self.held.len() > MAX_HELD {
                // Nothing was lost for good: the snapshot that is asked for holds it.
                self.held.pop_front();
                if self.state == State::InStep {
                    self.request.send()?;
                    self.state = State::Asked;
                }
            }
        }
        while let Some(snapshot) = self.snapshots.receive()? {
            if self.state != State::Asked {
                continue;
            }
            let seq = snapshot.header().frame.seq;
            self.held.retain(|update| update.header().frame.seq > seq);
            self.held.push_front(MapSample::Snapshot(snapshot));
            self.state = State::InStep;
        }
        Ok(())
    }

    /// The next message; nothing while a snapshot is awaited.
    pub(super) fn next(&mut self) -> Option<MapSample> {
        if self.state == State::InStep { self.held.pop_front() } else { None }
    }
}

//! Frames of two instances, joined by their number.

use std::collections::VecDeque;

use evac_frames::{FrameHeader, PoseFrame};
use evac_ports::services::{MapUpdate, OdometryPose, ScanDeskewed};
use evac_ports::{Bus, FrameSample, FrameSubscriber, Listener, PortError, RecordSubscriber};

/// Frames of one instance that wait for the other's.
const MAX_HELD: usize = 16;

/// A service that both instances write, each on its own bus.
pub(super) trait Port: Sized {
    type Item;

    fn open(bus: &Bus) -> Result<(Self, Listener), PortError>;
    fn receive(&self) -> Result<Option<Self::Item>, PortError>;
    fn frame(item: &Self::Item) -> &FrameHeader;
}

impl Port for RecordSubscriber<OdometryPose> {
    type Item = PoseFrame;

    fn open(bus: &Bus) -> Result<(Self, Listener), PortError> {
        Self::open(bus)
    }

    fn receive(&self) -> Result<Option<PoseFrame>, PortError> {
        self.receive()
    }

    fn frame(item: &PoseFrame) -> &FrameHeader {
        &item.frame
    }
}

impl Port for FrameSubscriber<ScanDeskewed> {
    type Item = FrameSample<ScanDeskewed>;

    fn open(bus: &Bus) -> Result<(Self, Listener), PortError> {
        Self::open(bus)
    }

    fn receive(&self) -> Result<Option<Self::Item>, PortError> {
        self.receive()
    }

    fn frame(item: &Self::Item) -> &FrameHeader {
        &item.header().frame
    }
}

impl Port for FrameSubscriber<MapUpdate> {
    type Item = FrameSample<MapUpdate>;

    fn open(bus: &Bus) -> Result<(Self, Listener), PortError> {
        Self::open(bus)
    }

    fn receive(&self) -> Result<Option<Self::Item>, PortError> {
        self.receive()
    }

    fn frame(item: &Self::Item) -> &FrameHeader {
        &item.header().frame
    }
}

/// Both streams.
pub(super) struct Pairs<P: Port> {
    sides: [Stream<P>; 2],
    has_begun: bool,
    /// Frames that one side only has put out since both do.
    pub(super) unmatched: u64,
}

struct Stream<P: Port> {
    port: P,
    held: VecDeque<P::Item>,
    newest: Option<u64>,
    frames: u64,
}

impl<P: Port> Pairs<P> {
    pub(super) fn open(buses: [&Bus; 2]) -> Result<(Self, [Listener; 2]), PortError> {
        let [(a, first), (b, second)] = [P::open(buses[0])?, P::open(buses[1])?];
        let stream = |port| Stream { port, held: VecDeque::new(), newest: None, frames: 0 };
        Ok((Self { sides: [stream(a), stream(b)], has_begun: false, unmatched: 0 }, [first, second]))
    }

    pub(super) fn frames(&self) -> [u64; 2] {
        [self.sides[0].frames, self.sides[1].frames]
    }

    /// Takes in what has come; `pair` gets every frame that both have, in order.
    pub(super) fn take_in(&mut self, mut pair: impl FnMut(&P::Item, &P::Item)) -> Result<(), PortError> {
        for side in &mut self.sides {
            self.unmatched += side.take_in()? * u64::from(self.has_begun);
        }
        loop {
            let [a, b] = &mut self.sides;
            let (Some(first), Some(second)) = (a.held.front(), b.held.front()) else { return Ok(()) };
            let order = P::frame(first).seq.cmp(&P::frame(second).seq);
            if order.is_eq() {
                pair(first, second);
                self.has_begun = true;
            } else {
                self.unmatched += u64::from(self.has_begun);
            }
            if order.is_le() {
                a.held.pop_front();
            }
            if order.is_ge() {
                b.held.pop_front();
            }
        }
    }
}

impl<P: Port> Stream<P> {
    /// Gives how many frames were given up.
    fn take_in(&mut self) -> Result<u64, PortError> {
        let mut given_up = 0;
        while let Some(item) = self.port.receive()? {
            let seq = P::frame(&item).seq;
            // Two instances of one side may both have put out a frame at a cut.
            if self.newest.is_some_and(|newest| seq <= newest) {
                continue;
            }
            (self.newest, self.frames) = (Some(seq), self.frames + 1);
            self.held.push_back(item);
            if self.held.len() > MAX_HELD {
                self.held.pop_front();
                given_up += 1;
            }
        }
        Ok(given_up)
    }
}

//! The map's stream: updates without a gap, or a snapshot and the updates after it.

use std::cmp::Ordering;
use std::collections::VecDeque;

use evac_frames::{MapHeader, Route, Voxel, map_flags};
use evac_ports::services::{MapSnapshot, MapUpdate, SNAPSHOT_REQUEST};
use evac_ports::{Bus, FrameSample, FrameSubscriber, Listener, PortError, RequestSender, now_ns};

use super::MAX_HELD;
use super::gated::GatedFrames;
use crate::{MapMessage, Reporter};

/// Messages whose frames are remembered while a snapshot is waited for.
const MAX_COVERED: usize = 3 * MAX_HELD;
/// Updates after which an unanswered request is made again: its mapper may have ended.
const ASK_AGAIN: u64 = MAX_HELD as u64;
/// Time after which one that resumes asks again, nanoseconds.
const RESUME_AGAIN_NS: i64 = 200_000_000;

/// An update or a snapshot in shared memory.
#[derive(Debug)]
pub(crate) enum MapSample {
    Update(FrameSample<MapUpdate>),
    /// An update without changes, or whose changes come with the snapshot after it: its frame is handed on, and nothing of the map.
    Covered(MapHeader),
    Snapshot(FrameSample<MapSnapshot>),
}

impl MapSample {
    pub(crate) fn header(&self) -> &MapHeader {
        match self {
            Self::Update(sample) => sample.header(),
            Self::Covered(header) => header,
            Self::Snapshot(sample) => sample.header(),
        }
    }

    pub(crate) fn message(&self) -> MapMessage<'_> {
        let voxels: &[Voxel] = match self {
            Self::Update(sample) => sample.items(),
            Self::Covered(_) => &[],
            Self::Snapshot(sample) => sample.items(),
        };
        MapMessage { header: self.header(), voxels }
    }

    pub(crate) fn is_snapshot(&self) -> bool {
        matches!(self, Self::Snapshot(_))
    }

    pub(crate) fn seq(&self) -> u64 {
        self.header().frame.seq
    }
}

/// Which map it is: the one that a mapper began, after so many key frames. Scans that are no key frame change nothing, so a
/// reader may miss them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Revision {
    map_epoch: u32,
    key_frames: u64,
}

impl Revision {
    fn after(header: &MapHeader) -> Self {
        Self { map_epoch: header.map_epoch, key_frames: header.key_frames }
    }

    fn before(header: &MapHeader) -> Self {
        let news = u64::from(header.map_flags & map_flags::KEY_FRAME != 0);
        Self { key_frames: header.key_frames.saturating_sub(news), ..Self::after(header) }
    }
}

/// Reads the map's stream. A reader that joins late, or that missed a key frame, asks for a snapshot and goes on from it, so
/// that it always ends with the same map.
#[derive(Debug)]
pub(crate) struct MapStream {
    updates: GatedFrames<MapUpdate>,
    snapshots: FrameSubscriber<MapSnapshot>,
    request: RequestSender,
    /// What was not handed on yet, in order: of updates at most [`MAX_HELD`], of snapshots one, which no update is in front of.
    held: VecDeque<MapSample>,
    limit: u64,
    /// The map after the last message that was handed on; `None` before the first.
    known: Option<Revision>,
    /// A snapshot is needed although no update has come: since when one was asked for, host monotonic time.
    resuming: Option<i64>,
    /// The newest update when a snapshot was asked for; `None` when none is awaited.
    asked_at: Option<u64>,
}

impl MapStream {
    pub(crate) fn open(bus: &Bus) -> Result<(Self, [Listener; 2]), PortError> {
        let (updates, update_listener) = GatedFrames::open(bus)?;
        let (snapshots, snapshot_listener) = FrameSubscriber::open(bus)?;
        let stream = Self {
            updates,
            snapshots,
            request: RequestSender::open(bus, SNAPSHOT_REQUEST)?,
            held: VecDeque::with_capacity(MAX_COVERED + MAX_HELD + 2),
            limit: u64::MAX,
            known: None,
            resuming: None,
            asked_at: None,
        };
        Ok((stream, [update_listener, snapshot_listener]))
    }

    /// Asks for the map at once: its updates may have ended, or wait for this reader.
    pub(crate) fn resume(&mut self) {
        self.resuming = Some(i64::MIN);
    }

    /// When it will ask again, host monotonic time.
    pub(crate) fn deadline_ns(&self) -> Option<i64> {
        let has_snapshot = self.held.front().is_some_and(MapSample::is_snapshot);
        self.resuming
            .filter(|_| !has_snapshot)
            .map(|asked_ns| asked_ns.saturating_add(RESUME_AGAIN_NS).max(now_ns()))
    }

    /// Whether a snapshot is awaited.
    pub(crate) fn waits(&self) -> bool {
        let has_snapshot = self.held.front().is_some_and(MapSample::is_snapshot);
        !has_snapshot && (self.resuming.is_some() || !self.is_in_step())
    }

    pub(crate) fn route(&mut self, route: &Route) {
        self.updates.route(route);
    }

    /// From `seq` on messages are held back.
    pub(crate) fn limit(&mut self, seq: u64) {
        self.limit = seq;
    }

    /// Number of the next message, if it can be handed on or is held back by the limit only.
    pub(crate) fn front(&self) -> Option<&MapSample> {
        self.held.front().filter(|_| self.is_in_step())
    }

    /// Number of the first message that is held, whether it can be handed on or not.
    pub(crate) fn first(&self) -> Option<u64> {
        self.held.front().map(MapSample::seq)
    }

    pub(crate) fn take_in(&mut self, reporter: &mut Reporter) -> Result<(), PortError> {
        // Before the updates: all that a snapshot covers is here with it.
        let mut snapshots = Vec::new();
        while let Some(snapshot) = self.snapshots.receive()? {
            snapshots.push(snapshot);
        }
        // What there is no room for stays where it is. While a snapshot is waited for, the newest updates are those that will join it.
        while (self.held.len() < MAX_HELD || !self.is_in_step())
            && let Some(update) = self.updates.receive(&mut reporter.input)?
        {
            reporter.received(update.header().frame.sent_ns);
            self.held.push_back(MapSample::Update(update));
            self.let_go(reporter);
        }
        snapshots.into_iter().for_each(|snapshot| self.offer(snapshot));
        self.ask_if_needed()
    }

    /// The next message; nothing while a snapshot is awaited.
    pub(crate) fn next(&mut self) -> Option<MapSample> {
        self.front().filter(|sample| sample.seq() < self.limit)?;
        let sample = self.held.pop_front()?;
        if !matches!(sample, MapSample::Covered(_)) {
            self.known = Some(Revision::after(sample.header()));
            self.resuming = None;
        }
        Some(sample)
    }

    /// Lets go of the oldest update where too many are held, as a snapshot is waited for; its frame is remembered.
    fn let_go(&mut self, reporter: &mut Reporter) {
        let is_update = |sample: &MapSample| matches!(sample, MapSample::Update(_));
        if self.held.iter().filter(|sample| is_update(sample)).count() > MAX_HELD
            && let Some(oldest) = self.held.iter_mut().find(|sample| is_update(sample))
        {
            *oldest = MapSample::Covered(*oldest.header());
        }
        if self.held.len() > MAX_COVERED + MAX_HELD {
            self.held.pop_front();
            reporter.input.lost += u64::from(self.known.is_some());
        }
    }

    /// Whether the first held message can be handed on, if there is one.
    fn is_in_step(&self) -> bool {
        let first = self.held.iter().find(|sample| !matches!(sample, MapSample::Covered(_)));
        let Some(MapSample::Update(update)) = first else { return true };
        let before = Revision::before(update.header());
        self.known.map_or(before.key_frames == 0, |known| known == before)
    }

    /// Goes on from a snapshot where one is needed and nothing is missing between it and the held updates.
    fn offer(&mut self, snapshot: FrameSample<MapSnapshot>) {
        if self.is_in_step() && self.resuming.is_none() {
            return;
        }
        let header = *snapshot.header();
        let same_map = |newest: &MapSample| newest.header().map_epoch == header.map_epoch;
        let next = self
            .held
            .iter()
            .find(|sample| sample.seq() > header.frame.seq && !matches!(sample, MapSample::Covered(_)));
        let joins = match next {
            Some(next) => Revision::before(next.header()) == Revision::after(&header),
            None => self.held.back().map_or(self.resuming.is_some(), same_map),
        };
        // Either way the next thing to do is known: go on, or ask for a newer one.
        self.asked_at = None;
        if !joins {
            return;
        }
        let mut snapshot = Some(MapSample::Snapshot(snapshot));
        for sample in std::mem::take(&mut self.held) {
            match sample.seq().cmp(&header.frame.seq) {
                // A late joiner has no use for what was before.
                Ordering::Less if self.known.is_some() && !sample.is_snapshot() => {
                    self.held.push_back(MapSample::Covered(*sample.header()));
                }
                Ordering::Less | Ordering::Equal => {}
                Ordering::Greater => {
                    self.held.extend(snapshot.take());
                    self.held.push_back(sample);
                }
            }
        }
        self.held.extend(snapshot);
    }

    fn ask_if_needed(&mut self) -> Result<(), PortError> {
        let has_snapshot = self.held.front().is_some_and(MapSample::is_snapshot);
        if let Some(asked_ns) = self.resuming.filter(|_| !has_snapshot)
            && now_ns() >= asked_ns.saturating_add(RESUME_AGAIN_NS)
        {
            self.resuming = Some(now_ns());
            return self.request.send();
        }
        let Some(newest) = self.held.back().map(MapSample::seq) else { return Ok(()) };
        let is_due = self.asked_at.is_none_or(|at| newest >= at + ASK_AGAIN);
        if !self.is_in_step() && is_due {
            self.request.send()?;
            self.asked_at = Some(newest);
        }
        Ok(())
    }
}

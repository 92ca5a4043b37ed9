//! The map with the pose of each scan.

use std::collections::VecDeque;

use evac_frames::{FrameHeader, MapHeader, PoseFrame, Route, TrackingState};
use evac_ports::services::OdometryPose;
use evac_ports::{Bus, Listener, PortError};

use super::gated::GatedRecords;
use super::map::{MapSample, MapStream};
use super::salvage::{Before, Salvage};
use super::{Join, JoinOptions};
use crate::{InputCounters, MapMessage, PlanInput, Reporter};

/// Poses kept until their map update comes: the mapper may be a few seconds behind.
const MAX_POSES: usize = 128;

/// Joins map updates with the poses of the same sequence number.
#[derive(Debug)]
pub struct PlanJoin {
    map: MapStream,
    poses: PoseQueue,
    salvage: Salvage,
    patience_ns: i64,
}

impl Join for PlanJoin {
    const SERVICES: &'static [&'static str] = &["map/update", "map/snapshot", "odometry/pose"];
    type Frame<'a> = PlanInput<'a>;

    fn open(bus: &Bus, options: JoinOptions) -> Result<(Self, Vec<Listener>), PortError> {
        let (poses, _) = GatedRecords::open(bus)?;
        let (map, listeners) = MapStream::open(bus)?;
        let join = Self {
            map,
            poses: PoseQueue::new(poses),
            salvage: Salvage::default(),
            patience_ns: options.patience_ns,
        };
        Ok((join, listeners.into()))
    }

    fn route(&mut self, route: &Route) {
        self.map.route(route);
        self.poses.route(route);
    }

    fn limit(&mut self, seq: u64) {
        self.map.limit(seq);
    }

    fn waits(&self) -> bool {
        self.map.waits()
    }

    fn front(&self) -> Option<u64> {
        self.map.front().map(MapSample::seq)
    }

    fn take_in(&mut self, reporter: &mut Reporter) -> Result<(), PortError> {
        // The map first: its update is published after the pose, so the pose of every update taken here is here too.
        self.map.take_in(reporter)?;
        self.poses.take_in()
    }

    fn next<R>(
        &mut self,
        reporter: &mut Reporter,
        process: impl FnOnce(Self::Frame<'_>, &FrameHeader, &mut Reporter) -> R,
    ) -> Option<R> {
        match self.salvage.before(&self.map, |last| self.poses.reaches(last)) {
            Before::Nothing => {}
            Before::Wait => return None,
            Before::Frame { from, last, header } => {
                if let Some(pose) = self.poses.first_of(from, last) {
                    let header = self.salvage.header(&header, &pose);
                    let map = MapMessage { header: &header, voxels: &[] };
                    return Some(process(PlanInput { map, pose: &pose }, &header.frame, reporter));
                }
            }
        }
        let sample = self.map.next()?;
        self.salvage.end();
        let frame = sample.header().frame;
        let pose = self.poses.at(frame.seq);
        reporter.input.late += u64::from(pose.is_none() && !sample.is_snapshot());
        let pose = pose.unwrap_or_else(|| position_only(sample.header()));
        Some(process(PlanInput { map: sample.message(), pose: &pose }, &frame, reporter))
    }

    fn resume(&mut self, after: Option<u64>) {
        self.map.resume();
        self.salvage.resume(after, self.patience_ns);
    }

    fn done(&mut self, frame: &FrameHeader) -> Option<FrameHeader> {
        self.salvage.done(frame)
    }

    fn deadline_ns(&self) -> Option<i64> {
        self.salvage.deadline_ns(&self.map)
    }
}

/// Poses in the order of their sequence numbers.
#[derive(Debug)]
pub(super) struct PoseQueue {
    port: GatedRecords<OdometryPose>,
    queue: VecDeque<PoseFrame>,
}

impl PoseQueue {
    pub(super) fn new(port: GatedRecords<OdometryPose>) -> Self {
        Self { port, queue: VecDeque::with_capacity(MAX_POSES + 1) }
    }

    pub(super) fn route(&mut self, route: &Route) {
        self.port.route(route);
    }

    pub(super) fn take_in(&mut self) -> Result<(), PortError> {
        // What is missing is counted where it would have been joined.
        while let Some(pose) = self.port.receive(&mut InputCounters::default())? {
            if self.queue.len() == MAX_POSES {
                self.queue.pop_front();
            }
            self.queue.push_back(pose);
        }
        Ok(())
    }

    /// Whether all poses up to scan `seq` have come that will.
    pub(super) fn reaches(&self, seq: u64) -> bool {
        self.queue.back().is_some_and(|pose| pose.frame.seq >= seq)
    }

    /// The first pose of a scan from `from` to `last`; older ones are done with.
    pub(super) fn first_of(&mut self, from: u64, last: u64) -> Option<PoseFrame> {
        while self.queue.front().is_some_and(|pose| pose.frame.seq < from) {
            self.queue.pop_front();
        }
        let is_wanted = self.queue.front().is_some_and(|pose| pose.frame.seq <= last);
        if is_wanted { self.queue.pop_front() } else { None }
    }

    /// The pose of scan `seq`, where it has come; older ones are done with.
    pub(super) fn at(&mut self, seq: u64) -> Option<PoseFrame> {
        while self.queue.front().is_some_and(|pose| pose.frame.seq < seq) {
            self.queue.pop_front();
        }
        self.queue.front().copied().filter(|pose| pose.frame.seq == seq)
    }
}

/// What the map's header says of a pose that did not come. No rotation is known, so there is none: the quaternion is zero
/// and the state that of a lost odometry, so that nobody takes it for a measured pose.
pub(super) fn position_only(header: &MapHeader) -> PoseFrame {
    PoseFrame {
        frame: header.frame,
        position: header.position,
        state: TrackingState::Lost as u32,
        ..PoseFrame::default()
    }
}

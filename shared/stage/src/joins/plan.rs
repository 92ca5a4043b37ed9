//! The map with the pose of each scan.

use std::collections::VecDeque;

use evac_frames::{FrameHeader, MapHeader, PoseFrame, Route, TrackingState};
use evac_ports::services::OdometryPose;
use evac_ports::{Bus, Listener, PortError};

use super::gated::GatedRecords;
use super::map::{MapSample, MapStream};
use super::{Join, JoinOptions};
use crate::{InputCounters, PlanInput, Reporter};

/// Poses kept until their map update comes: the mapper may be a few seconds behind.
const MAX_POSES: usize = 128;

/// Joins map updates with the poses of the same sequence number.
#[derive(Debug)]
pub struct PlanJoin {
    map: MapStream,
    poses: PoseQueue,
}

impl Join for PlanJoin {
    const SERVICES: &'static [&'static str] = &["map/update", "map/snapshot", "odometry/pose"];
    type Frame<'a> = PlanInput<'a>;

    fn open(bus: &Bus, _options: JoinOptions) -> Result<(Self, Vec<Listener>), PortError> {
        let (poses, _) = GatedRecords::open(bus)?;
        let (map, listeners) = MapStream::open(bus)?;
        Ok((Self { map, poses: PoseQueue::new(poses) }, listeners.into()))
    }

    fn route(&mut self, route: &Route) {
        self.map.route(route);
        self.poses.route(route);
    }

    fn limit(&mut self, seq: u64) {
        self.map.limit(seq);
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
        let sample = self.map.next()?;
        let frame = sample.header().frame;
        let pose = self.poses.at(frame.seq);
        reporter.input.late += u64::from(pose.is_none() && !sample.is_snapshot());
        let pose = pose.unwrap_or_else(|| position_only(sample.header()));
        Some(process(PlanInput { map: sample.message(), pose: &pose }, &frame, reporter))
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

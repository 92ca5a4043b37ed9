//! The map with the pose of each scan.

use std::collections::VecDeque;

use evac_frames::{FrameHeader, MapHeader, PoseFrame};
use evac_ports::services::OdometryPose;
use evac_ports::{Bus, Listener, PortError, RecordSubscriber};

use super::map::MapStream;
use super::{Join, JoinOptions};
use crate::{PlanInput, Reporter};

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
        let (poses, _) = RecordSubscriber::open(bus)?;
        let (map, listeners) = MapStream::open(bus)?;
        Ok((Self { map, poses: PoseQueue::new(poses) }, listeners.into()))
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
        let pose = self.poses.at(sample.header());
        let frame = sample.header().frame;
        Some(process(PlanInput { map: sample.message(), pose: &pose }, &frame, reporter))
    }
}

/// Poses in the order of their sequence numbers.
#[derive(Debug)]
pub(super) struct PoseQueue {
    port: RecordSubscriber<OdometryPose>,
    queue: VecDeque<PoseFrame>,
}

impl PoseQueue {
    pub(super) fn new(port: RecordSubscriber<OdometryPose>) -> Self {
        Self { port, queue: VecDeque::with_capacity(MAX_POSES + 1) }
    }

    pub(super) fn take_in(&mut self) -> Result<(), PortError> {
        while let Some(pose) = self.port.receive()? {
            if self.queue.len() == MAX_POSES {
                self.queue.pop_front();
            }
            self.queue.push_back(pose);
        }
        Ok(())
    }

    /// The pose of the map update's scan. For a snapshot older than the first pose here, the position in the map's header.
    pub(super) fn at(&mut self, header: &MapHeader) -> PoseFrame {
        while self.queue.front().is_some_and(|pose| pose.frame.seq < header.frame.seq) {
            self.queue.pop_front();
        }
        match self.queue.front() {
            Some(pose) if pose.frame.seq == header.frame.seq => *pose,
            _ => PoseFrame {
                frame: header.frame,
                position: header.position,
                orientation: [0.0, 0.0, 0.0, 1.0],
                ..PoseFrame::default()
            },
        }
    }
}

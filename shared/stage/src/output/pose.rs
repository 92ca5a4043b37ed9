//! Poses: an odometry's, and the true ones of simulated devices.

use evac_frames::{OdometryHealth, PoseFrame};
use evac_ports::services::{OdometryPose, TruthPose};
use evac_ports::{Bus, PortError, RecordPublisher};

use super::{StageOutput, failed, stamp};
use crate::follow::{Followed, PoseFollower, Routed};
use crate::{StageError, tracking};

/// Where poses go.
#[derive(Debug, Default)]
pub struct PoseOutput {
    /// What was published, newest last, where no shared memory is connected.
    pub memory: Vec<PoseFrame>,
    newest_only: bool,
    odometry: OdometryHealth,
    port: Option<(RecordPublisher<OdometryPose>, u32)>,
}

impl PoseOutput {
    /// Keeps only the newest pose in memory, so that publishing does not allocate.
    pub fn newest_only() -> Self {
        Self { newest_only: true, memory: Vec::with_capacity(1), ..Self::default() }
    }

    /// Publishes a pose.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(&mut self, pose: &PoseFrame) -> Result<(), StageError> {
        tracking::count(&mut self.odometry, pose);
        let Some((port, epoch)) = &self.port else {
            if self.newest_only {
                self.memory.clear();
            }
            self.memory.push(*pose);
            return Ok(());
        };
        let mut pose = *pose;
        stamp(&mut pose.frame, *epoch);
        port.publish(&pose).map_err(failed)
    }
}

impl StageOutput for PoseOutput {
    const SERVICES: &'static [&'static str] = &["odometry/pose"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        Ok(Self { port: Some((RecordPublisher::open(bus)?, epoch)), ..Self::default() })
    }

    fn odometry(&self) -> OdometryHealth {
        self.odometry
    }

    fn greet(&self) -> Result<(), PortError> {
        self.port.as_ref().map_or(Ok(()), |(port, _)| port.greet())
    }
}

impl Followed for PoseOutput {
    type Follower = PoseFollower;

    fn note(&mut self, routed: &Routed<'_, Self>) {
        tracking::count(&mut self.odometry, routed);
    }

    fn repeat(&mut self, routed: Routed<'_, Self>) -> Result<(), StageError> {
        self.publish(routed)
    }
}

/// Where the true poses of simulated devices go.
#[derive(Debug, Default)]
pub struct TruthOutput {
    /// What was published, newest last, where no shared memory is connected.
    pub memory: Vec<PoseFrame>,
    port: Option<(RecordPublisher<TruthPose>, u32)>,
}

impl TruthOutput {
    /// Publishes a pose.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(&mut self, pose: &PoseFrame) -> Result<(), StageError> {
        let mut pose = *pose;
        let Some((port, epoch)) = &self.port else {
            self.memory.push(pose);
            return Ok(());
        };
        stamp(&mut pose.frame, *epoch);
        port.publish(&pose).map_err(failed)
    }
}

impl StageOutput for TruthOutput {
    const SERVICES: &'static [&'static str] = &["truth/pose"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        Ok(Self { port: Some((RecordPublisher::open(bus)?, epoch)), ..Self::default() })
    }
}

//! What sinks write to beside their files: flat maps, or nothing.

use evac_frames::GridHeader;
use evac_ports::services::{Cell, GridPlan};
use evac_ports::{Bus, FramePublisher, PortError};

use super::{StageOutput, failed, keep, stamp};
use crate::StageError;
use crate::follow::{AckFollower, Followed, Routed};

/// Where flat maps go.
#[derive(Debug, Default)]
pub struct GridOutput {
    /// What was published, newest last, where no shared memory is connected.
    pub memory: Vec<(GridHeader, Vec<i8>)>,
    port: Option<(FramePublisher<GridPlan>, u32)>,
}

impl GridOutput {
    /// Publishes a plan of `header.width * header.height` cells; `fill(i)` is called once for each index in order.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(
        &mut self,
        header: &GridHeader,
        mut fill: impl FnMut(usize) -> i8,
    ) -> Result<(), StageError> {
        let mut header = *header;
        let len = header.width as usize * header.height as usize;
        let Some((port, epoch)) = &self.port else {
            keep(&mut self.memory, false, header, len, fill);
            return Ok(());
        };
        let finish = || {
            stamp(&mut header.frame, *epoch);
            header
        };
        port.publish(len, |i| Cell(fill(i)), finish).map_err(failed)
    }
}

impl StageOutput for GridOutput {
    const SERVICES: &'static [&'static str] = &["grid/plan"];
    const IS_SINK: bool = true;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        Ok(Self { port: Some((FramePublisher::open(bus)?, epoch)), ..Self::default() })
    }
}

impl Followed for GridOutput {
    type Follower = AckFollower;

    fn repeat(&mut self, _routed: Routed<'_, Self>) -> Result<(), StageError> {
        Ok(())
    }
}

/// For sinks that write files only.
#[derive(Debug, Default)]
pub struct NoOutput;

impl StageOutput for NoOutput {
    const SERVICES: &'static [&'static str] = &[];
    const IS_SINK: bool = true;

    fn open(_bus: &Bus, _epoch: u32) -> Result<Self, PortError> {
        Ok(Self)
    }
}

impl Followed for NoOutput {
    type Follower = AckFollower;

    fn repeat(&mut self, _routed: Routed<'_, Self>) -> Result<(), StageError> {
        Ok(())
    }
}

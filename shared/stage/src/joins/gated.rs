//! Services whose writers may be swapped: their frames once and in order.

use evac_frames::{FrameHeader, MapHeader, PoseFrame, Route, ScanHeader};
use evac_ports::services::{FrameService, RecordService};
use evac_ports::{Bus, FrameSample, FrameSubscriber, Listener, PortError, RecordSubscriber};

use crate::InputCounters;
use crate::gate::Gate;

/// What carries the number of its scan.
pub(crate) trait Numbered {
    fn frame(&self) -> &FrameHeader;
}

impl Numbered for ScanHeader {
    fn frame(&self) -> &FrameHeader {
        &self.frame
    }
}

impl Numbered for MapHeader {
    fn frame(&self) -> &FrameHeader {
        &self.frame
    }
}

impl Numbered for PoseFrame {
    fn frame(&self) -> &FrameHeader {
        &self.frame
    }
}

/// Frames of the instance that is listened to.
#[derive(Debug)]
pub(crate) struct GatedFrames<S: FrameService> {
    port: FrameSubscriber<S>,
    gate: Gate<FrameSample<S>>,
}

impl<S: FrameService<Header: Numbered>> GatedFrames<S> {
    pub(crate) fn open(bus: &Bus) -> Result<(Self, Listener), PortError> {
        let (port, listener) = FrameSubscriber::open(bus)?;
        Ok((Self { port, gate: Gate::new(S::NAME) }, listener))
    }

    pub(crate) fn route(&mut self, route: &Route) {
        self.gate.route(route);
    }

    pub(crate) fn receive(&mut self, input: &mut InputCounters) -> Result<Option<FrameSample<S>>, PortError> {
        while let Some(sample) = self.port.receive()? {
            let FrameHeader { seq, epoch, .. } = *sample.header().frame();
            if let Some(sample) = self.gate.offer(seq, epoch, sample, input) {
                return Ok(Some(sample));
            }
        }
        Ok(self.gate.pop(input))
    }
}

/// Records of the instance that is listened to.
#[derive(Debug)]
pub(crate) struct GatedRecords<S: RecordService> {
    port: RecordSubscriber<S>,
    gate: Gate<S::Record>,
}

impl<S: RecordService<Record: Numbered>> GatedRecords<S> {
    pub(crate) fn open(bus: &Bus) -> Result<(Self, Listener), PortError> {
        let (port, listener) = RecordSubscriber::open(bus)?;
        Ok((Self { port, gate: Gate::new(S::NAME) }, listener))
    }

    pub(crate) fn route(&mut self, route: &Route) {
        self.gate.route(route);
    }

    pub(crate) fn receive(&mut self, input: &mut InputCounters) -> Result<Option<S::Record>, PortError> {
        while let Some(record) = self.port.receive()? {
            let FrameHeader { seq, epoch, .. } = *record.frame();
            if let Some(record) = self.gate.offer(seq, epoch, record, input) {
                return Ok(Some(record));
            }
        }
        Ok(self.gate.pop(input))
    }
}

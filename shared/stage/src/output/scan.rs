//! Scans: deskewed ones, and a device's own.

use evac_frames::{Point, ScanHeader};
use evac_ports::services::{FrameService, LidarScan, ScanDeskewed, SliceLen};
use evac_ports::{Bus, FramePublisher, PortError, now_ns};

use super::{StageOutput, failed, keep, stamp};
use crate::StageError;
use crate::follow::{Followed, Routed, ScanFollower};

/// Where deskewed scans go.
#[derive(Debug, Default)]
pub struct ScanOutput {
    /// What was published, newest last, where no shared memory is connected.
    pub memory: Vec<(ScanHeader, Vec<Point>)>,
    newest_only: bool,
    port: Option<(FramePublisher<ScanDeskewed>, u32)>,
}

impl ScanOutput {
    /// Keeps only the newest scan in memory and reuses its buffer, so that publishing does not allocate.
    pub fn newest_only() -> Self {
        Self { newest_only: true, ..Self::default() }
    }

    /// Publishes a scan of `len` points; `fill(i)` is called once for each index in order and its result written
    /// straight into the loaned memory. `header.points` is set to `len`.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(
        &mut self,
        header: &ScanHeader,
        len: usize,
        fill: impl FnMut(usize) -> Point,
    ) -> Result<(), StageError> {
        let mut header = *header;
        header.points = len as u32;
        let Some((port, epoch)) = &self.port else {
            keep(&mut self.memory, self.newest_only, header, len, fill);
            return Ok(());
        };
        let finish = || {
            stamp(&mut header.frame, *epoch);
            header
        };
        port.publish(len, fill, finish).map_err(failed)
    }
}

impl StageOutput for ScanOutput {
    const SERVICES: &'static [&'static str] = &["scan/deskewed"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        Ok(Self { port: Some((FramePublisher::open(bus)?, epoch)), ..Self::default() })
    }

    fn greet(&self) -> Result<(), PortError> {
        self.port.as_ref().map_or(Ok(()), |(port, _)| port.greet())
    }
}

impl Followed for ScanOutput {
    type Follower = ScanFollower;

    fn repeat(&mut self, routed: Routed<'_, Self>) -> Result<(), StageError> {
        let points = routed.items();
        self.publish(routed.header(), points.len(), |i| points.get(i).copied().unwrap_or_default())
    }
}

/// Where a device's scans go.
#[derive(Debug, Default)]
pub struct RawScanOutput {
    /// What was published, newest last, where no shared memory is connected.
    pub memory: Vec<(ScanHeader, Vec<Point>)>,
    newest_only: bool,
    next_seq: u64,
    port: Option<(FramePublisher<LidarScan>, u32)>,
}

impl RawScanOutput {
    /// Most points of a scan; a longer one is refused.
    pub const MAX_POINTS: usize = match <LidarScan as FrameService>::LEN {
        SliceLen::Fixed(points) | SliceLen::Growing(points) => points,
    };

    /// Keeps only the newest scan in memory and reuses its buffer, so that publishing does not allocate.
    pub fn newest_only() -> Self {
        Self { newest_only: true, ..Self::default() }
    }

    /// Publishes a scan of `header.points` points; `fill(i)` is called once for each index in order and its result written
    /// straight into the loaned memory. Shots without return are counted. Gives the header with that, its number and the moment
    /// of its hand-over.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(
        &mut self,
        mut header: ScanHeader,
        mut fill: impl FnMut(usize) -> Point,
    ) -> Result<ScanHeader, StageError> {
        header.frame.seq = self.next_seq;
        self.next_seq += 1;
        let len = header.points as usize;
        let no_return = std::cell::Cell::new(0);
        let fill = |index| {
            let point = fill(index);
            no_return.set(no_return.get() + u32::from(!point.is_return()));
            point
        };
        let Some((port, epoch)) = &self.port else {
            keep(&mut self.memory, self.newest_only, header, len, fill);
            (header.no_return, header.frame.sent_ns) = (no_return.get(), now_ns());
            if let Some((kept, _)) = self.memory.last_mut() {
                *kept = header;
            }
            return Ok(header);
        };
        let finish = || {
            header.no_return = no_return.get();
            stamp(&mut header.frame, *epoch);
            header
        };
        port.publish(len, fill, finish).map_err(failed)?;
        Ok(header)
    }
}

impl StageOutput for RawScanOutput {
    const SERVICES: &'static [&'static str] = &["lidar/scan"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        Ok(Self { port: Some((FramePublisher::open(bus)?, epoch)), ..Self::default() })
    }

    fn greet(&self) -> Result<(), PortError> {
        self.port.as_ref().map_or(Ok(()), |(port, _)| port.greet())
    }

    fn count_from(&mut self, seq: u64) {
        self.next_seq = seq;
    }
}

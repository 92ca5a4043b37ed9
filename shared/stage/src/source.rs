//! The contract of a producer that knows its whole stream: a recording or a simulated walk.

use crate::{Counters, Rig, StageConfig, StageError};
use evac_frames::{ImuSample, Point, PoseFrame, ScanHeader};

/// One thing a sensor said. Header fields `seq`, `arrival_ns`, `sent_ns` and `epoch` are filled in by the run loop.
#[derive(Debug, Clone, Copy)]
pub enum SensorEvent {
    /// An IMU sample.
    Imu(ImuSample),
    /// A scan of `header.points` points, which the run loop then asks for one by one with [`Source::point`], in order,
    /// writing each straight into shared memory.
    Scan(ScanHeader),
}

/// A finite stream of sensor data in the order of time (an IMU sample by its stamp, a scan by its end).
///
/// A scan's no-return shots stay in it as points at the origin, as the sensor sends them. The last scan carries
/// `frame_flags::END_OF_STREAM`.
pub trait Source: Sized {
    /// Name of the kind, for example `simulator`.
    const NAME: &'static str;
    /// Typed configuration.
    type Config: StageConfig;

    /// Opens the recording or builds the world.
    ///
    /// # Errors
    /// [`StageError::Config`] or [`StageError::File`].
    fn new(config: Self::Config, rig: &Rig) -> Result<Self, StageError>;

    /// The next event, `None` after the last.
    ///
    /// # Errors
    /// [`StageError::File`] naming the file, the offset and what to try.
    fn next_event(&mut self) -> Result<Option<SensorEvent>, StageError>;

    /// Point `index` of the scan that `next_event` has just announced; called once per index, in order.
    fn point(&mut self, index: usize) -> Point;

    /// The true pose at the end of the scan that `next_event` has just announced, where it is known. It is published
    /// before the scan, so that it is there when the scan has passed through the pipeline.
    fn truth(&self) -> Option<PoseFrame> {
        None
    }

    /// What was left out or damaged so far. The run loop asks after each event and reports it; scans with
    /// `lost_packets` it counts as degraded itself.
    ///
    /// `late`: packets or messages that came twice or out of order. `rejected`: data that was not passed on for any other
    /// reason, such as values that are not finite, damaged packets, or other devices' data.
    fn counters(&self) -> Counters {
        Counters::default()
    }

    /// Scans before `first_scan` were published by another instance: they are announced, but their points are not asked for. A source
    /// that computes points may leave that out.
    fn start_at(&mut self, _first_scan: u64) {}

    /// Scans in the whole stream, for progress; `None` where it is not known beforehand.
    fn total_scans(&self) -> Option<u64>;
}

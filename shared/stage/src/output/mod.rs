//! What stages write to: shared memory in a pipeline, plain vectors in tests and benches (`default()`).

mod imu;
mod map;
mod pose;
mod scan;
mod sink;

use evac_frames::{FrameHeader, OdometryHealth};
use evac_ports::{Bus, Listener, PortError, now_ns};

use crate::StageError;

pub use imu::ImuOutput;
pub use map::MapOutput;
pub use pose::{PoseOutput, TruthOutput};
pub use scan::{RawScanOutput, ScanOutput};
pub use sink::{GridOutput, NoOutput};

/// An output that the run loop can connect to the bus.
pub trait StageOutput: Sized {
    /// Services it writes.
    const SERVICES: &'static [&'static str];
    /// Whether no other stage waits for what it writes: the stage then acknowledges each frame, and a lossless source
    /// paces itself on that.
    const IS_SINK: bool;

    /// Opens the services.
    ///
    /// # Errors
    /// [`PortError`].
    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError>;

    /// What wakes the run loop for requests that [`crate::Stage::serve`] answers.
    ///
    /// # Errors
    /// [`PortError`].
    fn listeners(&self, _bus: &Bus) -> Result<Vec<Listener>, PortError> {
        Ok(Vec::new())
    }

    /// Hands what is remembered to readers that have come since the last frame.
    ///
    /// # Errors
    /// [`PortError`].
    fn greet(&self) -> Result<(), PortError> {
        Ok(())
    }

    /// The first frame is `seq`: a producer that ended got as far.
    fn count_from(&mut self, _seq: u64) {}

    /// What this output goes on with, in a number: the epoch of the mapper that began the map.
    fn lineage(&self) -> u32 {
        0
    }

    /// Goes on with what another instance began; `None`: begins anew.
    fn go_on_with(&mut self, _lineage: Option<u32>) {}

    /// Opens those of [`Self::SERVICES`] that are named, where some may be left out; otherwise all.
    ///
    /// # Errors
    /// [`PortError`].
    fn open_only(bus: &Bus, epoch: u32, _services: &[&str]) -> Result<Self, PortError> {
        Self::open(bus, epoch)
    }

    /// How the odometry fares whose output this is, for the health report; nothing for other stages.
    fn odometry(&self) -> OdometryHealth {
        OdometryHealth::default()
    }
}

fn failed(cause: PortError) -> StageError {
    StageError::Output(cause.to_string())
}

/// Marks a header with its writer and the moment of its hand-over.
fn stamp(frame: &mut FrameHeader, epoch: u32) {
    frame.epoch = epoch;
    frame.sent_ns = now_ns();
}

/// Frames kept in memory instead of shared memory.
fn keep<H, T>(
    memory: &mut Vec<(H, Vec<T>)>,
    newest_only: bool,
    header: H,
    len: usize,
    fill: impl FnMut(usize) -> T,
) {
    match memory.last_mut() {
        Some((kept_header, kept)) if newest_only => {
            *kept_header = header;
            kept.clear();
            kept.extend((0..len).map(fill));
        }
        _ => memory.push((header, (0..len).map(fill).collect())),
    }
}

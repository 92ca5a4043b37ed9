//! Joining streams: complete sets for the stages, out of several services, by sequence number and time.
//!
//! A join keeps scans by borrowing them from shared memory; no cloud is copied.

pub(crate) mod gated;
pub(crate) mod map;
mod plan;
mod salvage;
mod scan_imu;
mod scan_pose;
mod seq;
mod sink;
mod tap;
mod tap_port;

use evac_frames::{FrameHeader, Route};
use evac_ports::{Bus, Listener, PortError};

pub use plan::PlanJoin;
pub use scan_imu::{DeskewedScanWithImu, RawScanWithImu, ScanImuJoin};
pub use scan_pose::ScanPoseJoin;
pub use sink::SinkJoin;
pub use tap::TapJoin;

use crate::Reporter;

/// How a join deals with what does not come.
#[derive(Debug, Clone, Copy)]
pub struct JoinOptions {
    /// Lossless mode: wait for every partner instead of going on without it.
    pub lossless: bool,
    /// Whether an odometry runs in the pipeline, whose poses the deskewer may wait for.
    pub has_odometry: bool,
    /// How long a scan waits for the IMU samples that cover it and, where it needs it, for the pose before; nanoseconds.
    pub patience_ns: i64,
}

impl JoinOptions {
    /// Live, a scan waits 0.2 s: serial adapters batch up to 16 ms, ten times that is a fault. In lossless mode a run
    /// whose partner does not come within 20 s is broken.
    pub fn new(lossless: bool, has_odometry: bool) -> Self {
        let patience_ns = if lossless { 20_000_000_000 } else { 200_000_000 };
        Self { lossless, has_odometry, patience_ns }
    }
}

/// Scans that a join may hold while it waits for their partners; below what the services let a subscriber borrow. Those after them
/// wait in the port, which keeps 32.
pub(crate) const MAX_HELD: usize = 20;

/// Collects from several services what one call of a stage needs.
pub trait Join: Sized {
    /// Services it reads.
    const SERVICES: &'static [&'static str];
    /// A complete set, borrowed from the join.
    type Frame<'a>;

    /// Opens the services, with the listeners that wake the run loop.
    ///
    /// # Errors
    /// [`PortError`].
    fn open(bus: &Bus, options: JoinOptions) -> Result<(Self, Vec<Listener>), PortError>;

    /// Takes the launcher's word on which instance of a stage is listened to.
    fn route(&mut self, route: &Route);

    /// From frame `seq` on sets are held back; without a limit at first.
    fn limit(&mut self, seq: u64);

    /// This instance leads in the place of one that was killed, which had written down all up to frame `after`.
    fn resume(&mut self, _after: Option<u64>) {}

    /// Whether it waits for what it has asked another stage for, so that what comes meanwhile is no sign that this one hangs.
    fn waits(&self) -> bool {
        false
    }

    /// Number of the first set that is not handed on yet, whole or not.
    fn front(&self) -> Option<u64>;

    /// Takes everything that has come.
    ///
    /// # Errors
    /// [`PortError`].
    fn take_in(&mut self, reporter: &mut Reporter) -> Result<(), PortError>;

    /// Hands the next complete set to `process` with the header it is counted by; `None` when there is none.
    fn next<R>(
        &mut self,
        reporter: &mut Reporter,
        process: impl FnOnce(Self::Frame<'_>, &FrameHeader, &mut Reporter) -> R,
    ) -> Option<R>;

    /// The frame that is done with once the set counted as `frame` has been processed, which a sink acknowledges: usually the
    /// same one.
    fn done(&mut self, frame: &FrameHeader) -> Option<FrameHeader> {
        Some(*frame)
    }

    /// Host monotonic time at which to look again: `next` will go on without what has not come, or something may have come that wakes nobody.
    fn deadline_ns(&self) -> Option<i64> {
        None
    }
}

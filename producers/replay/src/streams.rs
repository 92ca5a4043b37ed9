//! The two halves of a recording.

use evac_formats::FormatError;
use evac_frames::{ImuSample, Point, PoseFrame, ScanHeader};
use evac_stage::Counters;

/// Nanoseconds of one second.
pub(crate) const SECOND: i64 = 1_000_000_000;

/// Scans in the order of time.
pub(crate) trait ScanStream {
    /// The next scan, `None` after the last; its points replace those in `points`.
    fn next_scan(&mut self, points: &mut Vec<Point>) -> Result<Option<ScanHeader>, FormatError>;

    /// The true pose of the scan that was read last, where the recording has it.
    fn truth(&self) -> Option<PoseFrame> {
        None
    }

    /// Scans in the recording, for progress.
    fn total(&self) -> u64;

    /// What was left out so far.
    fn counters(&self) -> Counters;
}

/// IMU samples in the order of time, with finite values.
pub(crate) trait ImuStream {
    fn next_sample(&mut self) -> Result<Option<ImuSample>, FormatError>;

    /// What was left out so far.
    fn counters(&self) -> Counters;
}

/// A recording, opened.
pub(crate) struct Recording {
    pub(crate) scans: Box<dyn ScanStream>,
    pub(crate) imu: Box<dyn ImuStream>,
}

/// A sample at `stamp_ns`, unless a value is not finite.
pub(crate) fn imu_sample(stamp_ns: i64, gyro: [f64; 3], accel: [f64; 3]) -> Option<ImuSample> {
    let finite = gyro.iter().chain(&accel).all(|value| value.is_finite());
    finite.then(|| ImuSample { stamp_ns, gyro, accel, ..ImuSample::default() })
}

/// Seconds for messages.
pub(crate) fn seconds(nanoseconds: i64) -> f64 {
    nanoseconds as f64 * 1e-9
}

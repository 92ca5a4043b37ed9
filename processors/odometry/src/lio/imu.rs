//! IMU readings in the filter's own form, and the stretch of them between two frame ends.

use evac_frames::ImuSample;
use evac_geometry::nalgebra::Vector3;

/// Readings kept: 20 s at 200 Hz.
const CAPACITY: usize = 4096;
/// Values no device of this class reports: 2900 degrees/s and 20 g.
const MAX_RATE: f64 = 50.0;
const MAX_ACCEL: f64 = 200.0;
/// The sample after a frame's end comes at most so late.
const MAX_LEAD_NS: i64 = 1_000_000_000;
/// So many exact zeros in a row are the firmware's auto-zero and no chance of quantisation.
const ZERO_RUN: u32 = 5;

/// One reading, IMU frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reading {
    /// Sensor time of the IMU.
    pub(crate) stamp_ns: i64,
    /// Angular velocity, rad/s.
    pub(crate) gyro: Vector3<f64>,
    /// Specific force, m/s^2.
    pub(crate) accel: Vector3<f64>,
    /// The gyroscope's firmware holds its output at zero: the rate is small, not measured.
    pub(crate) held: bool,
}

/// Readings not yet integrated and the last one before them, in the order of time.
#[derive(Debug)]
pub(crate) struct ImuTrack {
    readings: Vec<Reading>,
    zero_run: u32,
    newest_ns: i64,
    /// Samples that were not finite or impossible.
    pub(crate) rejected: u64,
}

impl ImuTrack {
    pub(crate) fn new() -> Self {
        Self { readings: Vec::with_capacity(CAPACITY), zero_run: 0, newest_ns: i64::MIN, rejected: 0 }
    }

    /// Takes what is new in `samples` of the frame that ends at `frame_end_ns`; consecutive calls overlap.
    pub(crate) fn extend(&mut self, samples: &[ImuSample], frame_end_ns: i64) {
        for sample in samples {
            if sample.stamp_ns <= self.newest_ns {
                continue;
            }
            let (gyro, accel) = (Vector3::from(sample.gyro), Vector3::from(sample.accel));
            // NaN compares false and is rejected with the impossible.
            let possible = gyro.norm() < MAX_RATE && accel.norm() < MAX_ACCEL;
            // A stamp far ahead is a fault that would shut out all that follows.
            let early = sample.stamp_ns.saturating_sub(frame_end_ns) > MAX_LEAD_NS;
            if !possible || early || self.readings.len() >= CAPACITY {
                self.rejected += 1;
                continue;
            }
            self.newest_ns = sample.stamp_ns;
            self.zero_run = if gyro == Vector3::zeros() { self.zero_run.saturating_add(1) } else { 0 };
            self.readings.push(Reading {
                stamp_ns: sample.stamp_ns,
                gyro,
                accel,
                held: self.zero_run >= ZERO_RUN,
            });
            if self.zero_run == ZERO_RUN {
                let start = self.readings.len().saturating_sub(ZERO_RUN as usize);
                self.readings.iter_mut().skip(start).for_each(|reading| reading.held = true);
            }
        }
    }

    /// All readings kept.
    pub(crate) fn readings(&self) -> &[Reading] {
        &self.readings
    }

    /// Forgets everything before the last reading at or before `stamp_ns`.
    pub(crate) fn forget_before(&mut self, stamp_ns: i64) {
        let after = self.readings.partition_point(|reading| reading.stamp_ns <= stamp_ns);
        self.readings.drain(..after.saturating_sub(1));
    }

    /// Forgets all, for a step of the sensors' clock.
    pub(crate) fn clear(&mut self) {
        self.readings.clear();
        self.newest_ns = i64::MIN;
        self.zero_run = 0;
    }
}

/// The reading between `a` and `b` at `stamp_ns`, linear.
pub(crate) fn between(a: &Reading, b: &Reading, stamp_ns: i64) -> Reading {
    let span = (b.stamp_ns - a.stamp_ns) as f64;
    let share = if span > 0.0 { ((stamp_ns - a.stamp_ns) as f64 / span).clamp(0.0, 1.0) } else { 0.0 };
    Reading {
        stamp_ns,
        gyro: a.gyro.lerp(&b.gyro, share),
        accel: a.accel.lerp(&b.accel, share),
        held: a.held && b.held,
    }
}

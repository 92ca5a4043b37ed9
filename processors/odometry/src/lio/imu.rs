//! IMU readings in the filter's own form, and the stretch of them between two frame ends.

use evac_frames::ImuSample;
use evac_geometry::ImuConditioner;
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
    conditioner: ImuConditioner,
    zero_run: u32,
    newest_ns: i64,
    /// Samples that were not finite or impossible.
    pub(crate) rejected: u64,
}

impl ImuTrack {
    pub(crate) fn new() -> Self {
        Self {
            readings: Vec::with_capacity(CAPACITY),
            conditioner: ImuConditioner::default(),
            zero_run: 0,
            newest_ns: i64::MIN,
            rejected: 0,
        }
    }

    /// Takes what is new in `samples` of the frame that ends at `frame_end_ns`, and shows it to `watcher`, conditioned;
    /// consecutive calls overlap.
    pub(crate) fn extend(
        &mut self,
        samples: &[ImuSample],
        frame_end_ns: i64,
        mut watcher: impl FnMut(&ImuSample),
    ) {
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
            let conditioned = self.conditioner.push(sample);
            if let (Some(last), Some(corrected)) = (self.readings.last_mut(), conditioned.previous) {
                (last.gyro, last.accel) = (corrected.gyro.into(), corrected.accel.into());
            }
            watcher(&conditioned.sample);
            let (gyro, accel) =
                (Vector3::from(conditioned.sample.gyro), Vector3::from(conditioned.sample.accel));
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

    /// Spikes taken out so far.
    pub(crate) fn spikes(&self) -> u64 {
        self.conditioner.spikes()
    }

    /// Whether accelerations come in g and are converted.
    pub(crate) fn is_in_g(&self) -> bool {
        self.conditioner.is_in_g()
    }

    /// All readings kept.
    pub(crate) fn readings(&self) -> &[Reading] {
        &self.readings
    }

    /// The readings from the last one at or before `stamp_ns` on.
    pub(crate) fn readings_since(&self, stamp_ns: i64) -> &[Reading] {
        let after = self.readings.partition_point(|reading| reading.stamp_ns <= stamp_ns);
        self.readings.get(after.saturating_sub(1)..).unwrap_or_default()
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

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(k: i64, gyro: f64) -> ImuSample {
        ImuSample {
            stamp_ns: k * 5_000_000,
            gyro: [gyro, 0.0, 0.0],
            accel: [0.0, 0.0, 9.8],
            ..Default::default()
        }
    }

    #[test]
    fn a_run_of_exact_zeros_is_held_from_its_start_and_a_single_zero_is_not() {
        let mut track = ImuTrack::new();
        let samples: Vec<_> =
            (0..30).map(|k| sample(k, if (10..20).contains(&k) || k == 25 { 0.0 } else { 0.01 })).collect();
        track.extend(&samples[..14], 70_000_000, |_| {});
        track.extend(&samples[13..], 150_000_000, |_| {});
        let held: Vec<bool> = track.readings().iter().map(|reading| reading.held).collect();
        assert_eq!(held.len(), 30);
        assert!((0..30).all(|k| held[k] == (10..20).contains(&k)));
    }

    #[test]
    fn impossible_values_and_stamps_far_ahead_are_refused_and_counted() {
        let mut track = ImuTrack::new();
        let far = sample(1_000_000, 0.1);
        track.extend(&[sample(0, f64::NAN), sample(1, 1e6), far, sample(2, 0.1)], 100_000_000, |_| {});
        assert_eq!((track.readings().len(), track.rejected), (1, 3));
    }

    #[test]
    fn the_last_reading_at_or_before_the_border_is_kept() {
        let mut track = ImuTrack::new();
        track.extend(&(0..10).map(|k| sample(k, 0.1)).collect::<Vec<_>>(), 100_000_000, |_| {});
        track.forget_before(22_000_000);
        assert_eq!(track.readings()[0].stamp_ns, 20_000_000);
    }
}

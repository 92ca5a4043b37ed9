//! Faults of the IMU's stream.

use evac_frames::ImuSample;
use evac_geometry::STANDARD_GRAVITY;
use evac_geometry::nalgebra::Vector3;
use evac_simulator::Random;

use super::moving_frame;
use crate::Walk;

/// Rates below this are rest to the firmware, rad/s (0.8 deg/s).
const QUIET_RAD_S: f64 = 0.8 * std::f64::consts::PI / 180.0;
/// It is a standstill after so long below, nanoseconds.
const STANDSTILL_NS: i64 = 300_000_000;
/// Small rates stay hidden for so long after it, nanoseconds.
const HIDDEN_NS: i64 = 200_000_000;
/// White noise that the walks' accelerometers have, m/s^2 a sample.
const ACCEL_NOISE: f64 = 0.03;

pub(super) fn auto_zero(walk: &Walk) -> Walk {
    let mut imu = walk.imu();
    if zeroed(&imu) {
        return walk.clone();
    }
    // The firmware has calibrated itself before the walk: what it compares has no bias.
    let bias = resting_rate(&imu);
    let mut quiet_since: Option<i64> = imu.first().map(|first| first.stamp_ns - STANDSTILL_NS);
    let mut rested_until = i64::MIN;
    for sample in &mut imu {
        let rate = Vector3::from(sample.gyro) - bias;
        let quiet = rate.amax() < QUIET_RAD_S;
        quiet_since = if quiet { quiet_since.or(Some(sample.stamp_ns)) } else { None };
        if quiet_since.is_some_and(|since| sample.stamp_ns - since >= STANDSTILL_NS) {
            sample.gyro = [0.0; 3];
            rested_until = sample.stamp_ns;
        } else if sample.stamp_ns <= rested_until.saturating_add(HIDDEN_NS) {
            for (read, rate) in sample.gyro.iter_mut().zip(rate.iter()) {
                if rate.abs() < QUIET_RAD_S {
                    *read = 0.0;
                }
            }
        }
    }
    walk.with_imu(&imu)
}

/// Whether the gyroscope reads exact zeros for the length of a standstill.
fn zeroed(imu: &[ImuSample]) -> bool {
    imu.chunk_by(|a, b| a.gyro == [0.0; 3] && b.gyro == [0.0; 3]).any(|run| match run {
        [first, .., last] => first.gyro == [0.0; 3] && last.stamp_ns - first.stamp_ns >= STANDSTILL_NS,
        _ => false,
    })
}

/// Mean rate of the first half second, in which every walk stands.
fn resting_rate(imu: &[ImuSample]) -> Vector3<f64> {
    let Some(first) = imu.first() else { return Vector3::zeros() };
    let end = imu.partition_point(|sample| sample.stamp_ns <= first.stamp_ns + 500_000_000);
    let rest = imu.get(..end).unwrap_or_default();
    rest.iter().map(|sample| Vector3::from(sample.gyro)).sum::<Vector3<f64>>() / rest.len().max(1) as f64
}

pub(super) fn clock_offset(walk: &Walk, offset_ns: i64) -> Walk {
    changed(walk, |sample| sample.stamp_ns = sample.stamp_ns.saturating_add(offset_ns))
}

pub(super) fn gyro_scale(walk: &Walk, scale: f64) -> Walk {
    changed(walk, |sample| sample.gyro = sample.gyro.map(|rate| rate * scale))
}

pub(super) fn in_g(walk: &Walk) -> Walk {
    changed(walk, |sample| sample.accel = sample.accel.map(|force| force / STANDARD_GRAVITY))
}

/// Adds what makes the noise three times as large.
pub(super) fn accel_noise(walk: &Walk, random: &mut Random) -> Walk {
    let added = ACCEL_NOISE * 8_f64.sqrt();
    changed(walk, |sample| {
        for (force, noise) in sample.accel.iter_mut().zip(random.normals()) {
            *force += noise * added;
        }
    })
}

/// A device of half the rate numbers its own samples.
pub(super) fn every_second(walk: &Walk) -> Walk {
    let mut imu: Vec<_> = walk.imu().into_iter().step_by(2).collect();
    imu.iter_mut().zip(0..).for_each(|(sample, seq)| sample.seq = seq);
    walk.with_imu(&imu)
}

/// The first gap is 7 s after the first sample.
pub(super) fn gaps(walk: &Walk) -> Walk {
    const EVERY_NS: i64 = 7_000_000_000;
    const LENGTH_NS: i64 = 50_000_000;
    let mut imu = walk.imu();
    let first_ns = imu.first().map_or(0, |first| first.stamp_ns);
    imu.retain(|sample| {
        let since = sample.stamp_ns - first_ns;
        since < EVERY_NS || since % EVERY_NS >= LENGTH_NS
    });
    walk.with_imu(&imu)
}

pub(super) fn gap(walk: &Walk) -> Walk {
    const HALF_NS: i64 = 250_000_000;
    let mut imu = walk.imu();
    let middle_ns = walk.frames.get(moving_frame(walk)).map_or(0, |frame| frame.header.frame.end_ns);
    imu.retain(|sample| (sample.stamp_ns - middle_ns).abs() >= HALF_NS);
    walk.with_imu(&imu)
}

pub(super) fn spike(walk: &Walk, random: &mut Random) -> Walk {
    const SPIKE_RAD_S: f64 = 1600.0 * std::f64::consts::PI / 180.0;
    let mut imu = walk.imu();
    // In the middle of a frame, where deskewing sees it too.
    let at_ns = walk.frames.get(moving_frame(walk)).map_or(0, |frame| {
        let header = &frame.header.frame;
        header.start_ns + (header.end_ns - header.start_ns) / 2
    });
    let index = imu.partition_point(|sample| sample.stamp_ns < at_ns);
    let axis = (random.uniform() * 3.0) as usize;
    if let Some(rate) = imu.get_mut(index).and_then(|sample| sample.gyro.get_mut(axis)) {
        *rate = SPIKE_RAD_S;
    }
    walk.with_imu(&imu)
}

fn changed(walk: &Walk, change: impl FnMut(&mut ImuSample)) -> Walk {
    let mut imu = walk.imu();
    imu.iter_mut().for_each(change);
    walk.with_imu(&imu)
}

//! The gyroscope's readings, and what they turn by between two times.

use evac_frames::ImuSample;
use evac_geometry::nalgebra::{Matrix3, UnitQuaternion, Vector3};
use evac_geometry::{ImuConditioner, exp_so3};

use crate::correction::Correction;

/// So many exact zeros in a row are the firmware's auto-zero.
const ZERO_RUN: usize = 5;
/// After it slow rates stay hidden for so long, seconds (0.2 s and a margin).
const HIDDEN_S: f64 = 0.3;
/// Readings farther apart than this have others missing between them, seconds.
const GAP_S: f64 = 0.025;

/// The readings of a walk in the order of time.
#[derive(Debug, Default)]
pub(crate) struct Gyro {
    readings: Vec<Reading>,
    /// For each reading how many stretches without a measured rate lie before it.
    holes: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Reading {
    /// IMU clock, seconds since the walk's reference time.
    time_s: f64,
    /// rad/s.
    rate: Vector3<f64>,
}

/// What a stretch turned by, as the rig's configuration sees the IMU, with its derivatives: right errors of the
/// turn by bias and scale.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Turn {
    pub(crate) rotation: UnitQuaternion<f64>,
    pub(crate) by_bias: Matrix3<f64>,
    pub(crate) by_scale: Matrix3<f64>,
}

impl Turn {
    pub(crate) fn none() -> Self {
        Self { rotation: UnitQuaternion::identity(), by_bias: Matrix3::zeros(), by_scale: Matrix3::zeros() }
    }

    /// Derivative of the right error by the misalignment: with `C = Exp(m) C_true Exp(-m)` it is `C^T - 1`.
    pub(crate) fn by_misalignment(&self) -> Matrix3<f64> {
        self.rotation.inverse().to_rotation_matrix().matrix() - Matrix3::identity()
    }
}

impl Gyro {
    /// Readings with times counted from `reference_ns`; single garbled ones are replaced as the odometry does it.
    pub(crate) fn new(samples: &[ImuSample], reference_ns: i64) -> Self {
        let mut conditioner = ImuConditioner::default();
        let mut readings: Vec<Reading> = Vec::with_capacity(samples.len());
        for sample in samples {
            let conditioned = conditioner.push(sample);
            if let (Some(last), Some(corrected)) = (readings.last_mut(), conditioned.previous) {
                last.rate = corrected.gyro.into();
            }
            let time_s = sample.stamp_ns.saturating_sub(reference_ns) as f64 * 1e-9;
            let rate = Vector3::from(conditioned.sample.gyro);
            let later = readings.last().is_none_or(|last| time_s > last.time_s);
            if later && rate.iter().all(|rate| rate.is_finite()) {
                readings.push(Reading { time_s, rate });
            }
        }
        let holes = holes(&readings);
        Self { readings, holes }
    }

    /// Whether the rate was measured at all times between these.
    pub(crate) fn covers(&self, from_s: f64, to_s: f64) -> bool {
        let first = self.readings.partition_point(|reading| reading.time_s <= from_s);
        let last = self.readings.partition_point(|reading| reading.time_s < to_s);
        match (first.checked_sub(1).and_then(|first| self.holes.get(first)), self.holes.get(last)) {
            (Some(before), Some(after)) => before == after,
            _ => false,
        }
    }

    /// Carries `turn` on from one time to a later one.
    pub(crate) fn carry_on(&self, turn: &mut Turn, from_s: f64, to_s: f64, known: &Correction) {
        let aligned = exp_so3(&known.misalignment);
        let matrix = aligned.to_rotation_matrix();
        let first = self.readings.partition_point(|reading| reading.time_s <= from_s).saturating_sub(1);
        for pair in self.readings.get(first..).unwrap_or_default().windows(2) {
            let [a, b] = pair else { continue };
            if a.time_s >= to_s {
                break;
            }
            let (start_s, end_s) = (a.time_s.max(from_s), b.time_s.min(to_s));
            let h = end_s - start_s;
            if h <= 0.0 {
                continue;
            }
            let unbiased = between(a, b, (start_s + end_s) / 2.0) - known.gyro_bias;
            let true_rate = unbiased - known.gyro_scale.component_mul(&unbiased);
            let step = exp_so3(&(aligned * true_rate * h));
            turn.rotation *= step;
            let back = step.inverse().to_rotation_matrix();
            turn.by_bias = back * turn.by_bias - matrix.matrix() * h;
            turn.by_scale = back * turn.by_scale - matrix.matrix() * Matrix3::from_diagonal(&(unbiased * h));
        }
    }

    /// True angular velocity at a time, rad/s, as the rig's configuration sees the IMU.
    pub(crate) fn rate_at(&self, time_s: f64, known: &Correction) -> Vector3<f64> {
        let after = self.readings.partition_point(|reading| reading.time_s <= time_s);
        let pair = after.checked_sub(1).and_then(|before| self.readings.get(before..=after));
        let Some([a, b]) = pair else { return Vector3::zeros() };
        let unbiased = between(a, b, time_s) - known.gyro_bias;
        exp_so3(&known.misalignment) * (unbiased - known.gyro_scale.component_mul(&unbiased))
    }

    /// Root mean square of the rate about each axis where it was measured, rad/s.
    pub(crate) fn rms_rate(&self) -> Vector3<f64> {
        let squares = |sum: Vector3<f64>, reading: &Reading| sum + reading.rate.component_mul(&reading.rate);
        let sum = self.readings.iter().fold(Vector3::zeros(), squares);
        (sum / self.readings.len().max(1) as f64).map(f64::sqrt)
    }
}

/// The rate on the line between two readings.
fn between(a: &Reading, b: &Reading, time_s: f64) -> Vector3<f64> {
    a.rate.lerp(&b.rate, ((time_s - a.time_s) / (b.time_s - a.time_s)).clamp(0.0, 1.0))
}

/// Counts the holes: gaps, and zeros that are no measurement with the time after them.
fn holes(readings: &[Reading]) -> Vec<u32> {
    let mut hidden = vec![false; readings.len()];
    let mut start = 0;
    for run in readings.chunk_by(|a, b| (a.rate == Vector3::zeros()) == (b.rate == Vector3::zeros())) {
        let end = start + run.len();
        if let (Some(first), true) = (run.first(), run.len() >= ZERO_RUN)
            && first.rate == Vector3::zeros()
        {
            let until_s = run.last().map_or(first.time_s, |last| last.time_s) + HIDDEN_S;
            let after = readings.partition_point(|reading| reading.time_s < until_s);
            hidden.iter_mut().take(after.max(end)).skip(start).for_each(|hidden| *hidden = true);
        }
        start = end;
    }
    let mut count = 0;
    let mut before: Option<&Reading> = None;
    let mut counted = Vec::with_capacity(readings.len());
    for (reading, hidden) in readings.iter().zip(hidden) {
        let gap = before.is_some_and(|before| reading.time_s - before.time_s > GAP_S);
        count += u32::from(hidden || gap);
        counted.push(count);
        before = Some(reading);
    }
    counted
}

#[cfg(test)]
mod tests {
    use evac_geometry::log_so3;

    use super::*;

    fn gyro(rate: impl Fn(f64) -> Vector3<f64>) -> Gyro {
        let sample = |k: i64| ImuSample {
            stamp_ns: k * 5_000_000,
            gyro: rate(k as f64 * 0.005).into(),
            ..ImuSample::default()
        };
        Gyro::new(&(0..1000).map(sample).collect::<Vec<_>>(), 0)
    }

    #[test]
    fn the_derivatives_are_those_of_the_turn() {
        let gyro = gyro(|t| Vector3::new(0.3 * (3.0 * t).sin() + 0.1, -0.2, (2.0 * t).cos()));
        let known = Correction { misalignment: Vector3::new(0.1, -0.05, 0.2), ..Correction::default() };
        let turn_of = |known: &Correction| {
            let mut turn = Turn::none();
            gyro.carry_on(&mut turn, 0.5033, 2.5, known);
            turn
        };
        let centre = turn_of(&known);
        let step = 1e-6;
        for axis in 0..3 {
            let mut d = Vector3::zeros();
            d[axis] = step;
            let right_error =
                |known: &Correction| log_so3(&(centre.rotation.inverse() * turn_of(known).rotation)) / step;
            let by_bias = right_error(&Correction { gyro_bias: known.gyro_bias + d, ..known });
            let by_scale = right_error(&Correction { gyro_scale: known.gyro_scale + d, ..known });
            let aligned = log_so3(&(exp_so3(&d) * exp_so3(&known.misalignment)));
            let by_misalignment = right_error(&Correction { misalignment: aligned, ..known });
            // First order in a step of 5 ms.
            assert!((by_bias - centre.by_bias.column(axis)).norm() < 0.01);
            assert!((by_scale - centre.by_scale.column(axis)).norm() < 0.01);
            assert!((by_misalignment - centre.by_misalignment().column(axis)).norm() < 1e-3);
        }
    }

    #[test]
    fn a_silent_or_held_gyroscope_covers_nothing_and_neither_does_the_time_outside() {
        let held = gyro(|t| if (1.0..1.5).contains(&t) { Vector3::zeros() } else { Vector3::repeat(0.1) });
        assert!(held.covers(0.2, 0.9) && held.covers(2.0, 3.0));
        for (from_s, to_s) in [(0.9, 1.1), (1.1, 1.2), (1.6, 1.7), (0.5, 2.5), (-0.1, 0.2), (4.9, 5.1)] {
            assert!(!held.covers(from_s, to_s), "{from_s} to {to_s}");
        }
    }
}

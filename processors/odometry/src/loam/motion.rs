//! The motion prior: by the IMU where the scan was deskewed with it, by constant velocity otherwise.

use evac_frames::ImuSample;
use evac_geometry::nalgebra::{UnitQuaternion, Vector3};
use evac_geometry::{
    ImuIntegrator, ImuState, MotionState, STANDARD_GRAVITY, StandstillDetector, exp_so3, log_so3,
};

use super::config::LoamConfig;
use super::filter::{Covariance, Filter, POSITION, ROTATION, VELOCITY};

/// Samples of one frame that are integrated: 2 s at 1000 Hz.
const MAX_SAMPLES: usize = 2048;
/// Longest time without a sample that the IMU's word is taken for, nanoseconds.
const MAX_GAP_NS: i64 = 100_000_000;
/// No carrier keeps such a mean acceleration or rate over a frame, m/s^2 and rad/s.
const MAX_MEAN_ACCEL: f64 = 6.0;
const MAX_MEAN_RATE: f64 = 6.0;
/// A frame at rest has the standstill's mean specific force and angular velocity within this, m/s^2 and rad/s: the onset of
/// a motion shows here before the detector believes it.
const REST_ACCEL: f64 = 0.04;
const REST_RATE: f64 = 0.003;
/// A steady glide looks like rest to an IMU; a filter that knows of one is not stopped, m/s.
const REST_SPEED: f64 = 0.15;
/// What a resting rig may still do per frame, metres and radians.
const REST_STEP: f64 = 3e-4;

/// Time of a frame: from the one before to its end.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span<'a> {
    pub(crate) end_ns: i64,
    /// Seconds since the frame before; positive.
    pub(crate) h: f64,
    /// Samples that may be used: none where the scan was not deskewed by them.
    pub(crate) imu: &'a [ImuSample],
    /// Gravity is known in the map.
    pub(crate) levelled: bool,
}

/// Predicts, with its buffer.
#[derive(Debug)]
pub(crate) struct Motion {
    integrator: ImuIntegrator,
}

impl Motion {
    pub(crate) fn new() -> Self {
        Self { integrator: ImuIntegrator::new(MAX_SAMPLES) }
    }

    /// Carries the filter on to the frame's end; returns whether the IMU did it.
    pub(crate) fn predict(
        &mut self,
        filter: &mut Filter,
        span: &Span<'_>,
        detector: &StandstillDetector,
        config: &LoamConfig,
    ) -> bool {
        let inertial = self.integrate(filter, span);
        let h = span.h;
        match inertial {
            Some(_) if filter.velocity.norm() < REST_SPEED && at_rest(span.imu, detector) => rest(filter),
            Some((rotation, change)) => {
                let force = if change == Vector3::zeros() { change } else { change / h - gravity() };
                filter.propagate_covariance(h, &force);
                filter.position += (filter.velocity + change / 2.0) * h;
                filter.velocity += change;
                filter.rotation = rotation;
                let accel_error =
                    if force == Vector3::zeros() { config.free_accel_m_s2 } else { config.accel_error_m_s2 };
                add_acceleration(&mut filter.covariance, accel_error, h);
                filter.add_variance(ROTATION, (config.gyro_error_rad_s * h).powi(2));
            }
            None => {
                filter.propagate_covariance(h, &Vector3::zeros());
                filter.position += filter.velocity * h;
                filter.rotation *= exp_so3(&(filter.rate * h));
                add_acceleration(&mut filter.covariance, config.free_accel_m_s2, h);
                filter.add_variance(ROTATION, (config.free_turn_rad_s2 * h * h).powi(2));
            }
        }
        filter.stamp_ns = span.end_ns;
        filter.velocity = filter.velocity.cap_magnitude(config.max_speed_m_s);
        inertial.is_some()
    }

    /// Rotation at the end and change of the velocity by the IMU; no change where its acceleration cannot be used.
    fn integrate(&mut self, filter: &Filter, span: &Span<'_>) -> Option<(UnitQuaternion<f64>, Vector3<f64>)> {
        let start = ImuState {
            time_ns: filter.stamp_ns,
            world_from_imu: filter.rotation,
            position: Vector3::zeros(),
            velocity: Vector3::zeros(),
            gyro_bias: filter.gyro_bias,
            accel_bias: filter.accel_bias,
            gravity: gravity(),
            time_offset_ns: 0,
        };
        if span.imu.is_empty() {
            return None;
        }
        let coverage = self.integrator.integrate(&start, span.imu, span.end_ns);
        let gap_ns = [coverage.longest_interval_ns, coverage.uncovered_start_ns, coverage.uncovered_end_ns];
        let end = self.integrator.end_state(&start);
        let turn = log_so3(&(start.world_from_imu.inverse() * end.world_from_imu)).norm();
        if coverage.used == 0 || gap_ns.iter().any(|gap| *gap > MAX_GAP_NS) || turn > MAX_MEAN_RATE * span.h {
            return None;
        }
        let usable = span.levelled && end.velocity.norm() < MAX_MEAN_ACCEL * span.h;
        Some((end.world_from_imu, if usable { end.velocity } else { Vector3::zeros() }))
    }
}

fn gravity() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -STANDARD_GRAVITY)
}

fn rest(filter: &mut Filter) {
    filter.velocity = Vector3::zeros();
    filter.covariance.fixed_rows_mut::<3>(VELOCITY).fill(0.0);
    filter.covariance.fixed_columns_mut::<3>(VELOCITY).fill(0.0);
    filter.add_variance(VELOCITY, 0.02_f64.powi(2));
    filter.add_variance(POSITION, REST_STEP.powi(2));
    filter.add_variance(ROTATION, REST_STEP.powi(2));
}

/// Whether the IMU says that the rig has been standing and still does.
fn at_rest(samples: &[ImuSample], detector: &StandstillDetector) -> bool {
    let (MotionState::Still, Some(standstill)) = (detector.state(), detector.standstill()) else {
        return false;
    };
    let n = samples.len().max(1) as f64;
    let mean = |of: fn(&ImuSample) -> [f64; 3]| {
        samples.iter().map(|sample| Vector3::from(of(sample))).sum::<Vector3<f64>>() / n
    };
    (mean(|sample| sample.accel) - standstill.mean_accel).norm() < REST_ACCEL
        && (mean(|sample| sample.gyro) - standstill.gyro_bias.unwrap_or_default()).norm() < REST_RATE
}

/// Adds what an unknown acceleration, constant over the frame, does to position and velocity.
fn add_acceleration(covariance: &mut Covariance, accel: f64, h: f64) {
    let variance = accel * accel * h * h;
    for i in 0..3 {
        let (p, v) = (POSITION + i, VELOCITY + i);
        covariance[(p, p)] += variance * h * h / 4.0;
        covariance[(p, v)] += variance * h / 2.0;
        covariance[(v, p)] += variance * h / 2.0;
        covariance[(v, v)] += variance;
    }
}

#[cfg(test)]
mod tests {
    use evac_geometry::nalgebra::Isometry3;

    use super::*;

    fn filter() -> Filter {
        let mut filter = Filter::new(0, &Isometry3::identity(), 0.1, 0.001);
        filter.velocity = Vector3::new(1.0, 0.0, 0.0);
        filter.rate = Vector3::new(0.0, 0.0, 0.5);
        filter
    }

    fn samples(gyro: [f64; 3], accel: [f64; 3]) -> Vec<ImuSample> {
        (0..=20).map(|k| ImuSample { stamp_ns: k * 5_000_000, gyro, accel, ..Default::default() }).collect()
    }

    fn predict(imu: &[ImuSample]) -> (Filter, bool) {
        let mut filter = filter();
        let span = Span { end_ns: 100_000_000, h: 0.1, imu, levelled: true };
        let inertial =
            Motion::new().predict(&mut filter, &span, &StandstillDetector::default(), &LoamConfig::default());
        (filter, inertial)
    }

    #[test]
    fn without_imu_the_motion_goes_on_as_it_was() {
        let (filter, inertial) = predict(&[]);
        assert!(!inertial);
        assert!((filter.position.x - 0.1).abs() < 1e-12);
        assert!((filter.rotation.scaled_axis().z - 0.05).abs() < 1e-12);
    }

    #[test]
    fn the_imu_says_how_the_motion_changes_and_is_trusted_more() {
        let (filter, inertial) = predict(&samples([0.0, 0.0, 1.0], [2.0, 0.0, STANDARD_GRAVITY]));
        assert!(inertial);
        assert!((filter.rotation.scaled_axis().z - 0.1).abs() < 1e-9);
        assert!((filter.velocity.x - 1.2).abs() < 2e-3);
        let (free, _) = predict(&[]);
        assert!(free.covariance[(POSITION, POSITION)] > 2.0 * filter.covariance[(POSITION, POSITION)]);
        assert!(free.covariance[(5, 5)] > 100.0 * filter.covariance[(5, 5)]);
    }

    #[test]
    fn an_acceleration_that_nobody_can_have_is_not_followed() {
        let (filter, _) = predict(&samples([0.0, 0.0, 1.0], [80.0, 0.0, STANDARD_GRAVITY]));
        assert!((filter.velocity.x - 1.0).abs() < 1e-9);
        assert!((filter.rotation.scaled_axis().z - 0.1).abs() < 1e-9);
    }

    #[test]
    fn samples_that_end_before_the_frame_are_no_imu() {
        let mut imu = samples([0.0, 0.0, 1.0], [0.0, 0.0, STANDARD_GRAVITY]);
        imu.iter_mut().for_each(|sample| sample.stamp_ns -= 400_000_000);
        assert!(!predict(&imu).1);
    }
}

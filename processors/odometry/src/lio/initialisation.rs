//! Gravity, biases and their uncertainty from a standstill, or from motion where there is none (design section 5.1).

use evac_geometry::nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use evac_geometry::{MotionState, STANDARD_GRAVITY, Standstill, StandstillDetector, exp_so3};

use super::batch_means::Batches;
use super::config::LioConfig;
use super::imu::Reading;
use super::state::{Covariance, State, add_gravity_variance, add_variance, at};

/// Prior of the accelerometer's bias across gravity, which a standstill cannot tell from tilt, m/s^2.
const ACCEL_BIAS: f64 = 0.05;
/// Least standard deviation of the mean acceleration of a start in motion, m/s^2, and that of its velocity, m/s.
const MOVING_ACCEL: f64 = 0.05;
const MOVING_SPEED: f64 = 1.0;
/// The detector measures in blocks of 0.1 s.
const TOLERANCE_S: f64 = 0.05;
/// Memory of the mean acceleration of a start in motion.
const MOVING_MEMORY_S: f64 = 2.0;

/// What the start found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Start {
    pub(crate) state: State,
    pub(crate) covariance: Covariance,
    /// Noise seen at rest per sample, m/s^2 and rad/s; zero where it cannot be seen.
    pub(crate) accel_noise: f64,
    pub(crate) gyro_noise: f64,
    /// False: no standstill came and the start is in motion.
    pub(crate) standing: bool,
}

/// Waits until the carrier has stood still long enough, or too long a time has passed.
#[derive(Debug)]
pub(crate) struct Initialiser {
    waited_s: f64,
    last: Option<Reading>,
    /// Mean specific force turned into the present IMU frame, with exponential memory.
    mean_force: Vector3<f64>,
    mean_weight: f64,
    batches: Batches,
}

impl Initialiser {
    pub(crate) fn new() -> Self {
        Self {
            waited_s: 0.0,
            last: None,
            mean_force: Vector3::zeros(),
            mean_weight: 0.0,
            batches: Batches::default(),
        }
    }

    /// Takes the readings up to a frame's end, `duration_s` after the last one's.
    pub(crate) fn take(&mut self, readings: &[Reading], duration_s: f64) {
        self.waited_s += duration_s.clamp(0.0, 1.0);
        let fresh = self.last.map_or(0, |last| readings.partition_point(|r| r.stamp_ns <= last.stamp_ns));
        for reading in readings.iter().skip(fresh) {
            self.level(reading);
        }
    }

    /// Orientation `map_from_imu` as far as it is known: z against gravity, yaw of the LiDAR zero.
    pub(crate) fn orientation(
        &self,
        detector: &StandstillDetector,
        imu_from_lidar: &Isometry3<f64>,
    ) -> UnitQuaternion<f64> {
        let up = match (detector.state(), detector.standstill()) {
            (MotionState::Still, Some(standstill)) => standstill.mean_accel,
            _ => self.mean_force,
        };
        up.try_normalize(1e-3).map_or(imu_from_lidar.rotation.inverse(), |up| upright(&up, imu_from_lidar))
    }

    /// The start, once it can be made; the IMU of a rig that `glides` steadily looks like one at rest.
    pub(crate) fn start(
        &self,
        detector: &StandstillDetector,
        glides: bool,
        config: &LioConfig,
        imu_from_lidar: &Isometry3<f64>,
    ) -> Option<Start> {
        standing(detector, glides, config, imu_from_lidar).or_else(|| {
            (self.waited_s >= config.start_timeout_s)
                .then(|| moving_start(&self.mean_force, self.batches.error(), config, imu_from_lidar))
        })
    }

    /// Keeps the mean of the specific force in the present IMU frame, turned along with the gyroscope.
    fn level(&mut self, reading: &Reading) {
        if let Some(last) = self.last {
            let h = (reading.stamp_ns - last.stamp_ns) as f64 * 1e-9;
            let turn = exp_so3(&(-(last.gyro + reading.gyro) / 2.0 * h));
            let turned = turn * self.mean_force;
            // A new clock starts anew.
            if h <= 0.0 {
                self.last = Some(*reading);
                return;
            }
            self.mean_weight = self.mean_weight * (-h / MOVING_MEMORY_S).exp() + h;
            self.batches.take(&turn, &reading.accel, h);
            self.mean_force = turned + (reading.accel - turned) * (h / self.mean_weight);
        } else {
            self.mean_force = reading.accel;
        }
        self.last = Some(*reading);
    }
}

/// The start from the standstill that the detector sees, once that is long enough; the IMU of a rig that `glides` steadily looks like
/// one at rest.
pub(crate) fn standing(
    detector: &StandstillDetector,
    glides: bool,
    config: &LioConfig,
    imu_from_lidar: &Isometry3<f64>,
) -> Option<Start> {
    let standstill = detector.standstill()?;
    let seconds = (standstill.end_ns - standstill.start_ns) as f64 * 1e-9;
    let is_enough = seconds > config.standstill_s - TOLERANCE_S;
    (!glides && detector.state() == MotionState::Still && is_enough)
        .then(|| standing_start(standstill, config, imu_from_lidar))
}

fn standing_start(standstill: &Standstill, config: &LioConfig, imu_from_lidar: &Isometry3<f64>) -> Start {
    let up = standstill.mean_accel.try_normalize(1.0).unwrap_or_else(Vector3::z);
    let n = standstill.samples.max(1) as f64;
    let mut start = start_at(&upright(&up, imu_from_lidar), imu_from_lidar);
    start.standing = true;
    start.state.accel_bias = standstill.mean_accel - up * STANDARD_GRAVITY;
    start.accel_noise = standstill.accel_std.max();
    start.gyro_noise = standstill.gyro_std.map_or(0.0, |std| std.max());
    // A gyroscope held at zero by its firmware hides its bias.
    start.state.gyro_bias = standstill.gyro_bias.unwrap_or_default();
    let bias_variance = match standstill.gyro_bias {
        Some(_) => config.gyro_noise_rad_s.max(start.gyro_noise).powi(2) / n,
        None => config.hidden_gyro_bias_rad_s.powi(2),
    };
    add_variance(&mut start.covariance, at::VELOCITY, 1e-6);
    add_variance(&mut start.covariance, at::GYRO_BIAS, bias_variance);
    let accel_variance = config.accel_noise_m_s2.max(start.accel_noise).powi(2) / n;
    add_variance(&mut start.covariance, at::ACCEL_BIAS, accel_variance);
    start
}

/// `error`: standard error of `force` across gravity as its scatter shows it, m/s^2.
fn moving_start(
    force: &Vector3<f64>,
    error: f64,
    config: &LioConfig,
    imu_from_lidar: &Isometry3<f64>,
) -> Start {
    let orientation = match force.try_normalize(1.0) {
        Some(up) => upright(&up, imu_from_lidar),
        None => imu_from_lidar.rotation.inverse(),
    };
    let mut start = start_at(&orientation, imu_from_lidar);
    add_variance(&mut start.covariance, at::VELOCITY, MOVING_SPEED.powi(2));
    add_variance(&mut start.covariance, at::GYRO_BIAS, config.hidden_gyro_bias_rad_s.powi(2));
    // While the mean was formed the gyroscope's unknown bias turned it.
    let turned = STANDARD_GRAVITY * config.hidden_gyro_bias_rad_s * MOVING_MEMORY_S / 2.0;
    let variance = error.max(MOVING_ACCEL).powi(2) + turned.powi(2);
    add_gravity_variance(&mut start.covariance, &start.state.gravity, variance);
    // Across the vertical the bias is part of what was taken for gravity, as at a standstill; along it nothing has measured it.
    let up = orientation.inverse() * Vector3::z();
    let mut bias = start.covariance.fixed_view_mut::<3, 3>(at::ACCEL_BIAS, at::ACCEL_BIAS);
    bias += up * up.transpose() * ACCEL_BIAS.powi(2);
    start
}

/// State at rest with the LiDAR at the map's origin. Gravity across the vertical and the accelerometer's bias have one
/// fully correlated uncertainty: what the standstill measured is their sum, and the first turn tells them apart.
fn start_at(map_from_imu: &UnitQuaternion<f64>, imu_from_lidar: &Isometry3<f64>) -> Start {
    let rotation = map_from_imu.to_rotation_matrix();
    let state = State {
        rotation: *map_from_imu,
        position: -(map_from_imu * imu_from_lidar.translation.vector),
        ..State::at_origin()
    };
    let level = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0)) * ACCEL_BIAS.powi(2);
    let cross = level * rotation.matrix();
    let mut covariance = Covariance::zeros();
    add_variance(&mut covariance, at::ROTATION, 1e-10);
    add_variance(&mut covariance, at::POSITION, 1e-10);
    add_variance(&mut covariance, at::GRAVITY, 1e-12);
    add_variance(&mut covariance, at::ACCEL_BIAS, 1e-6);
    for (row, column, block) in [
        (at::GRAVITY, at::GRAVITY, level),
        (at::GRAVITY, at::ACCEL_BIAS, cross),
        (at::ACCEL_BIAS, at::GRAVITY, cross.transpose()),
        (at::ACCEL_BIAS, at::ACCEL_BIAS, rotation.matrix().transpose() * cross),
    ] {
        let mut view = covariance.fixed_view_mut::<3, 3>(row, column);
        view += block;
    }
    Start { state, covariance, accel_noise: 0.0, gyro_noise: 0.0, standing: false }
}

/// `map_from_imu` with `up` (IMU frame, any length) on the map's z and the LiDAR's x in the map's x-z plane, forward.
pub(crate) fn upright(up: &Vector3<f64>, imu_from_lidar: &Isometry3<f64>) -> UnitQuaternion<f64> {
    let up = &up.normalize();
    let level = |axis: Vector3<f64>| {
        let forward = imu_from_lidar.rotation * axis;
        (forward - up * forward.dot(up)).try_normalize(0.1)
    };
    // A LiDAR that looks straight up or down has no yaw of its own: its z takes the place of x.
    let Some(x) = level(Vector3::x()).or_else(|| level(Vector3::z())) else {
        return UnitQuaternion::identity();
    };
    let y = up.cross(&x);
    let imu_from_map = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, *up]));
    UnitQuaternion::from_rotation_matrix(&imu_from_map).inverse()
}

#[cfg(test)]
mod tests {
    use evac_frames::ImuSample;

    use super::*;

    fn stand(gyro: [f64; 3], accel: Vector3<f64>, rig: &Isometry3<f64>) -> Start {
        let (mut detector, mut initialiser) = (StandstillDetector::default(), Initialiser::new());
        for k in 0..400 {
            // Noise that the detector needs to judge changes by.
            let noise = Vector3::new(0.02, -0.02, 0.02) * if k % 2 == 0 { 1.0 } else { -1.0 };
            let sample = ImuSample {
                stamp_ns: k * 5_000_000,
                gyro,
                accel: (accel + noise).into(),
                ..Default::default()
            };
            detector.push(&sample);
        }
        initialiser.take(&[], 2.0);
        initialiser.start(&detector, false, &LioConfig::default(), rig).unwrap()
    }

    #[test]
    fn gravity_ends_on_the_maps_z_and_the_lidar_looks_along_its_x() {
        let rig = evac_geometry::imu_from_lidar([0.1, -0.2, 0.3], [10.0, -20.0, 30.0]);
        let tilt = UnitQuaternion::from_euler_angles(0.2, -0.3, 0.0);
        let map_from_imu = tilt * rig.rotation.inverse();
        let start = stand([0.01, 0.0, 0.0], map_from_imu.inverse() * Vector3::new(0.0, 0.0, 9.9), &rig);
        assert!(start.standing);
        let map_from_lidar = start.state.map_from_imu() * rig;
        assert!(map_from_lidar.rotation.angle_to(&tilt) < 1e-9);
        assert!(map_from_lidar.translation.vector.norm() < 1e-12);
        assert!((start.state.accel_bias.norm() - (9.9 - STANDARD_GRAVITY)).abs() < 1e-6);
        assert!((start.state.gyro_bias.x - 0.01).abs() < 1e-9);
    }

    #[test]
    fn tilt_and_accelerometer_bias_share_one_uncertainty_that_the_standstill_did_not_resolve() {
        let start = stand([0.01, 0.0, 0.0], Vector3::new(0.0, 0.0, 9.8), &Isometry3::identity());
        // What is measured at rest, bias - R^T g, is known; each part is not.
        let p = |i: usize, j: usize| start.covariance[(i, j)];
        let (g, b) = (at::GRAVITY, at::ACCEL_BIAS);
        assert!(p(g, g).sqrt() > 0.045 && p(b, b).sqrt() > 0.045);
        let sum = p(g, g) + p(b, b) - 2.0 * p(g, b);
        assert!(sum.sqrt() < 0.01, "{sum}");
    }

    #[test]
    fn a_gyroscope_that_reads_zeros_at_rest_has_an_unknown_bias() {
        let start = stand([0.0; 3], Vector3::new(0.0, 0.0, 9.8), &Isometry3::identity());
        assert_eq!(start.state.gyro_bias, Vector3::zeros());
        let hidden = LioConfig::default().hidden_gyro_bias_rad_s;
        assert!((start.covariance[(at::GYRO_BIAS, at::GYRO_BIAS)].sqrt() - hidden).abs() < 1e-12);
    }

    /// The start of somebody who walks 4 s with an acceleration of `forward` m/s^2 in the last of them.
    fn walk(forward: f64) -> Start {
        let mut initialiser = Initialiser::new();
        let readings: Vec<_> = (0..800)
            .map(|k| {
                let swing = 0.5 * (f64::from(k) * 0.06).sin();
                let ahead = if k < 600 { 0.0 } else { forward };
                let accel = Vector3::new(swing + ahead, -swing, STANDARD_GRAVITY + swing);
                Reading { stamp_ns: i64::from(k) * 5_000_000, gyro: Vector3::zeros(), accel, held: false }
            })
            .collect();
        initialiser.take(&readings, 1.0);
        initialiser.waited_s = 4.0;
        let (detector, rig) = (StandstillDetector::default(), Isometry3::identity());
        initialiser.start(&detector, false, &LioConfig::default(), &rig).unwrap()
    }

    #[test]
    fn one_who_stops_while_the_start_is_waited_for_is_less_sure_of_the_vertical_than_one_in_full_stride() {
        let tilt = |start: &Start| start.covariance[(at::GRAVITY, at::GRAVITY)].sqrt();
        let (steady, stopping) = (walk(0.0), walk(-1.0));
        assert!(tilt(&steady) < 0.11, "{}", tilt(&steady));
        assert!(tilt(&stopping) > 0.15, "{}", tilt(&stopping));
        let off = stopping.state.rotation.angle() * STANDARD_GRAVITY;
        assert!(off > 0.2 && off < 3.0 * tilt(&stopping), "{off}");
    }

    #[test]
    fn a_start_in_motion_lays_the_vertical_to_the_bias_and_not_to_the_length_of_gravity() {
        let start = walk(0.0);
        let sigma = |i: usize| start.covariance[(i, i)].sqrt();
        assert!(sigma(at::GRAVITY + 2) < 1e-3 && sigma(at::ACCEL_BIAS + 2) > 0.04);
    }
}

//! The start: gravity and biases from a standstill, gravity alone from a motion, neither without an IMU.

use evac_frames::ImuSample;
use evac_geometry::nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use evac_geometry::{MotionState, STANDARD_GRAVITY, StandstillDetector, exp_so3};

use super::config::LoamConfig;
use super::filter::Filter;

/// The detector measures in blocks of 0.1 s.
const TOLERANCE_S: f64 = 0.05;
/// Memory of the mean acceleration of a start in motion.
const MEMORY_S: f64 = 2.0;
/// Standard deviations after a standstill: its tilt is the map's and so exact, its bias across gravity hides in it.
const STANDING: (f64, f64) = (0.01, 1e-3);
/// Standard deviations of a start in motion, m/s and rad.
const MOVING: (f64, f64) = (1.0, 0.05);

/// A start that can be made.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Begun {
    pub(crate) filter: Filter,
    /// From a standstill; otherwise the velocity must be found first.
    pub(crate) standing: bool,
    /// The map's z is against gravity.
    pub(crate) levelled: bool,
}

/// Waits until the carrier has stood still long enough, or too long a time has passed.
#[derive(Debug)]
pub(crate) struct Start {
    waited_s: f64,
    last: Option<(i64, Vector3<f64>)>,
    /// Mean specific force turned into the present IMU frame, with exponential memory.
    mean_force: Vector3<f64>,
    weight: f64,
}

impl Start {
    pub(crate) fn new() -> Self {
        Self { waited_s: 0.0, last: None, mean_force: Vector3::zeros(), weight: 0.0 }
    }

    /// Takes the samples of a frame of `h` seconds; consecutive calls overlap.
    pub(crate) fn take(&mut self, samples: &[ImuSample], h: f64) {
        self.waited_s += h.clamp(0.0, 1.0);
        for sample in samples {
            self.level(sample);
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
        up.try_normalize(1.0).map_or(imu_from_lidar.rotation.inverse(), |up| upright(&up, imu_from_lidar))
    }

    /// Whether the orientation knows of gravity.
    pub(crate) fn is_levelled(&self) -> bool {
        self.mean_force.norm() > 1.0
    }

    /// The start, once it can be made. Without IMU there is nothing to wait for.
    pub(crate) fn begin(
        &self,
        end_ns: i64,
        with_imu: bool,
        detector: &StandstillDetector,
        config: &LoamConfig,
        imu_from_lidar: &Isometry3<f64>,
    ) -> Option<Begun> {
        let begin = |rotation: UnitQuaternion<f64>, (speed, tilt): (f64, f64)| {
            let position = -(rotation * imu_from_lidar.translation.vector);
            Filter::new(end_ns, &Isometry3::from_parts(position.into(), rotation), speed, tilt)
        };
        if !with_imu {
            let filter = begin(imu_from_lidar.rotation.inverse(), (MOVING.0, 1e-3));
            return Some(Begun { filter, standing: false, levelled: false });
        }
        let rotation = self.orientation(detector, imu_from_lidar);
        if detector.state() == MotionState::Still
            && let Some(standstill) = detector.standstill()
            && (standstill.end_ns - standstill.start_ns) as f64 * 1e-9 > config.standstill_s - TOLERANCE_S
        {
            let mut filter = begin(rotation, STANDING);
            let up = standstill.mean_accel.try_normalize(1.0).unwrap_or_else(Vector3::z);
            filter.accel_bias = standstill.mean_accel - up * STANDARD_GRAVITY;
            // A gyroscope held at zero by its firmware hides its bias.
            filter.gyro_bias = standstill.gyro_bias.unwrap_or_default();
            return Some(Begun { filter, standing: true, levelled: true });
        }
        let levelled = self.is_levelled();
        (self.waited_s >= config.start_timeout_s).then(|| Begun {
            filter: begin(rotation, MOVING),
            standing: false,
            levelled,
        })
    }

    /// Keeps the mean of the specific force in the present IMU frame, turned along with the gyroscope.
    fn level(&mut self, sample: &ImuSample) {
        let (gyro, force) = (Vector3::from(sample.gyro), Vector3::from(sample.accel));
        if !gyro.iter().chain(force.iter()).all(|value| value.abs() < 1e3) {
            return;
        }
        let Some((stamp_ns, last_gyro)) = self.last else {
            (self.last, self.mean_force) = (Some((sample.stamp_ns, gyro)), force);
            return;
        };
        let h = sample.stamp_ns.saturating_sub(stamp_ns) as f64 * 1e-9;
        if h <= 0.0 {
            // Seen before, or a new clock.
            if h < -1.0 {
                self.last = Some((sample.stamp_ns, gyro));
            }
            return;
        }
        let turned = exp_so3(&(-(last_gyro + gyro) / 2.0 * h.min(0.1))) * self.mean_force;
        self.weight = self.weight * (-h / MEMORY_S).exp() + h;
        self.mean_force = turned + (force - turned) * (h / self.weight);
        self.last = Some((sample.stamp_ns, gyro));
    }
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
    let imu_from_map = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, up.cross(&x), *up]));
    UnitQuaternion::from_rotation_matrix(&imu_from_map).inverse()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feed(force: Vector3<f64>, shake: f64) -> (Start, StandstillDetector) {
        let (mut start, mut detector) = (Start::new(), StandstillDetector::default());
        for frame in 0..40 {
            let samples: Vec<ImuSample> = (frame * 20..=frame * 20 + 20)
                .map(|k| {
                    let wave = Vector3::new(1.0, -1.0, 0.5) * (0.02 + shake * (k as f64 * 0.1).sin());
                    let side = if k % 2 == 0 { wave } else { wave * if shake > 0.0 { 1.0 } else { -1.0 } };
                    ImuSample { stamp_ns: k * 5_000_000, accel: (force + side).into(), ..Default::default() }
                })
                .collect();
            for sample in &samples {
                detector.push(sample);
            }
            start.take(&samples, 0.1);
        }
        (start, detector)
    }

    #[test]
    fn gravity_ends_on_the_maps_z_and_the_lidar_at_its_origin() {
        let rig = evac_geometry::imu_from_lidar([0.1, -0.2, 0.3], [10.0, -20.0, 30.0]);
        let tilt = UnitQuaternion::from_euler_angles(0.2, -0.3, 0.0);
        let (start, detector) = feed((tilt * rig.rotation.inverse()).inverse() * Vector3::z() * 9.9, 0.0);
        let begun = start.begin(0, true, &detector, &LoamConfig::default(), &rig).unwrap();
        assert!(begun.standing && begun.levelled);
        let map_from_lidar = begun.filter.map_from_imu() * rig;
        assert!(map_from_lidar.rotation.angle_to(&tilt) < 1e-6);
        assert!(map_from_lidar.translation.vector.norm() < 1e-12);
        assert!((begun.filter.accel_bias.norm() - (9.9 - STANDARD_GRAVITY)).abs() < 1e-6);
    }

    #[test]
    fn in_motion_the_start_waits_and_then_knows_less() {
        let rig = Isometry3::identity();
        let (start, detector) = feed(Vector3::z() * 9.8, 1.0);
        let begun = start.begin(0, true, &detector, &LoamConfig::default(), &rig).unwrap();
        assert!(!begun.standing && begun.levelled && begun.filter.covariance[(6, 6)] > 0.5);
        assert!(begun.filter.rotation.angle() < 0.1);
        assert!(Start::new().begin(0, true, &detector, &LoamConfig::default(), &rig).is_none());
    }

    #[test]
    fn without_an_imu_the_start_is_made_at_once_and_not_levelled() {
        let rig = evac_geometry::imu_from_lidar([0.1, 0.0, 0.0], [0.0, 10.0, 0.0]);
        let detector = StandstillDetector::default();
        let begun = Start::new().begin(5, false, &detector, &LoamConfig::default(), &rig).unwrap();
        assert!(!begun.standing && !begun.levelled);
        let map_from_lidar = begun.filter.map_from_imu() * rig;
        assert!(map_from_lidar.rotation.angle() < 1e-9 && map_from_lidar.translation.vector.norm() < 1e-9);
    }
}

//! What a module gives away by gravity: the scale of its accelerometer, which way is up, whether its firmware zeroes the
//! gyroscope at rest, and whether the gyroscope's scale and axes are the accelerometer's.

use evac_geometry::nalgebra::{UnitQuaternion, Vector3};
use evac_geometry::{GyroScale, GyroScaleCheck};

use crate::Config;

/// A second is at rest where largest and smallest rates differ by less than this, rad/s, and specific forces by less than this share
/// of gravity.
const GYRO_SPREAD: f64 = 0.05;
const ACCEL_SPREAD: f64 = 0.06;
/// Length of gravity may be off by this share: the sensor's own errors are below 2 %.
const GRAVITY_TOLERANCE: f64 = 0.05;
/// Exact zeros in a row that are no chance.
const ZEROS: u32 = 100;
/// How far from upright the LiDAR may be by the rig, degrees.
const UPRIGHT_DEG: f64 = 45.0;
/// Ranges that such modules are made with, g.
const RANGES_G: [f64; 4] = [2.0, 4.0, 8.0, 16.0];

/// What a second at rest has shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Finding {
    /// As it should be.
    Right,
    /// The length of gravity is that of another range, g.
    OtherRange { gravity_m_s2: f64, range_g: f64 },
    /// The length of gravity is that of no range.
    WrongGravity { gravity_m_s2: f64 },
    /// By the rig the LiDAR lies on its side or upside down: degrees from upright.
    NotUpright { tilt_deg: f64 },
}

/// Watches for seconds at rest.
#[derive(Debug)]
pub(crate) struct Rest {
    per_window: u32,
    one_g: f64,
    range_g: f64,
    lidar_from_imu: UnitQuaternion<f64>,
    samples: u32,
    sum: Vector3<f64>,
    low: [f64; 6],
    high: [f64; 6],
    zeros: u32,
    gyro: GyroScaleCheck,
    /// Newest finding.
    pub(crate) finding: Option<Finding>,
    /// Whether the gyroscope is held at zero now.
    pub(crate) zeroed: bool,
    /// Whether it ever was.
    pub(crate) auto_zero: bool,
}

impl Rest {
    pub(crate) fn new(config: &Config, rig: &evac_stage::Rig) -> Self {
        Self {
            per_window: config.rate_hz.max(1.0) as u32,
            one_g: config.one_g_m_s2,
            range_g: config.accel_range_g,
            lidar_from_imu: rig.imu_from_lidar().rotation.inverse(),
            samples: 0,
            sum: Vector3::zeros(),
            low: [f64::INFINITY; 6],
            high: [f64::NEG_INFINITY; 6],
            zeros: 0,
            gyro: GyroScaleCheck::new(config.one_g_m_s2),
            finding: None,
            zeroed: false,
            auto_zero: false,
        }
    }

    /// What gravity says of the gyroscope.
    pub(crate) fn gyro(&self) -> GyroScale {
        self.gyro.verdict()
    }

    pub(crate) fn push(&mut self, stamp_ns: i64, gyro: [f64; 3], accel: [f64; 3]) {
        self.gyro.push(stamp_ns, gyro, accel);
        self.zeros = if gyro == [0.0; 3] { self.zeros.saturating_add(1) } else { 0 };
        self.zeroed = self.zeros >= ZEROS;
        self.auto_zero |= self.zeroed;
        let values = gyro.iter().chain(&accel);
        for ((low, high), value) in self.low.iter_mut().zip(&mut self.high).zip(values) {
            *low = low.min(*value);
            *high = high.max(*value);
        }
        self.sum += Vector3::from(accel);
        self.samples += 1;
        if self.samples >= self.per_window {
            let mean = self.sum / f64::from(self.samples);
            if self.is_rest(mean.norm()) {
                self.finding = Some(self.judge(mean));
            }
            self.samples = 0;
            self.sum = Vector3::zeros();
            (self.low, self.high) = ([f64::INFINITY; 6], [f64::NEG_INFINITY; 6]);
        }
    }

    fn is_rest(&self, gravity: f64) -> bool {
        let limits = [[GYRO_SPREAD; 3], [ACCEL_SPREAD * gravity; 3]];
        let spreads = self.high.iter().zip(&self.low).map(|(high, low)| high - low);
        spreads.zip(limits.as_flattened()).all(|(spread, limit)| spread < *limit)
    }

    fn judge(&self, accel: Vector3<f64>) -> Finding {
        let gravity_m_s2 = accel.norm();
        let is_one_g = |ratio: f64| (ratio - 1.0).abs() < GRAVITY_TOLERANCE;
        if !is_one_g(gravity_m_s2 / self.one_g) {
            // With words of another range gravity is longer or shorter by the ranges' ratio.
            let fits = |range: &&f64| is_one_g(gravity_m_s2 * **range / self.range_g / self.one_g);
            return match RANGES_G.iter().find(fits) {
                Some(range_g) => Finding::OtherRange { gravity_m_s2, range_g: *range_g },
                None => Finding::WrongGravity { gravity_m_s2 },
            };
        }
        let tilt_deg = (self.lidar_from_imu * accel).angle(&Vector3::z()).to_degrees();
        if tilt_deg > UPRIGHT_DEG { Finding::NotUpright { tilt_deg } } else { Finding::Right }
    }
}

#[cfg(test)]
mod tests {
    use evac_stage::Rig;

    use super::*;

    fn after_rest(config: &Config, rig: &Rig, gyro: f64, accel: [f64; 3]) -> Rest {
        let mut rest = Rest::new(config, rig);
        for n in 0..400 {
            let noise = 0.01 * f64::from(n % 5 - 2);
            rest.push(i64::from(n) * 5_000_000, [gyro * noise; 3], accel.map(|value| value + noise));
        }
        rest
    }

    #[test]
    fn words_of_another_range_are_recognised_by_the_length_of_gravity() {
        let config = Config::default();
        let found = |accel| after_rest(&config, &Rig::default(), 1.0, accel).finding;
        assert_eq!(found([0.1, -0.2, 9.8]), Some(Finding::Right));
        // A module of 2 g whose words are read as 16 g.
        assert!(
            matches!(found([0.0, 0.0, 78.4]), Some(Finding::OtherRange { range_g, .. }) if range_g == 2.0)
        );
        assert!(
            matches!(found([0.0, 19.6, 0.0]), Some(Finding::OtherRange { range_g, .. }) if range_g == 8.0)
        );
        assert!(matches!(found([0.0, 0.0, 1.0]), Some(Finding::WrongGravity { .. })));
    }

    #[test]
    fn a_rig_by_which_the_lidar_lies_on_its_side_is_named() {
        let mut rig = Rig::default();
        rig.imu_from_lidar.roll_pitch_yaw_deg = [90.0, 0.0, 0.0];
        let config = Config::default();
        let finding = after_rest(&config, &rig, 1.0, [0.0, 0.0, 9.8]).finding;
        assert!(
            matches!(finding, Some(Finding::NotUpright { tilt_deg }) if (tilt_deg - 90.0).abs() < 1.0),
            "{finding:?}"
        );
        // The IMU mounted on its side, as the rig says: the LiDAR is upright.
        let finding = after_rest(&config, &rig, 1.0, [0.0, -9.8, 0.0]).finding;
        assert_eq!(finding, Some(Finding::Right));
    }

    #[test]
    fn exact_zeros_are_the_firmware_s_and_a_motion_is_no_rest() {
        let (config, rig) = (Config::default(), Rig::default());
        let rest = after_rest(&config, &rig, 0.0, [0.0, 0.0, 9.8]);
        assert!(rest.zeroed && rest.auto_zero);
        assert!(!after_rest(&config, &rig, 1.0, [0.0, 0.0, 9.8]).auto_zero);
        let mut moving = Rest::new(&config, &rig);
        for n in 0..400 {
            moving.push(i64::from(n) * 5_000_000, [f64::from(n) * 0.01, 0.0, 0.0], [0.0, 0.0, 78.4]);
        }
        assert_eq!(moving.finding, None);
    }
}

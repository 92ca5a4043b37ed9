//! The WT901C: noise, bias, 16-bit words, and the firmware's automatic zeroing of the gyroscope.

use evac_formats::wt901c::Scales;
use evac_geometry::nalgebra::Vector3;

use crate::config::Config;
use crate::random::Random;
use crate::trajectory::Motion;

/// Time between two samples at the default rate of 200 Hz, nanoseconds.
pub const SAMPLE_NS: i64 = 5_000_000;

/// The firmware calls it a standstill after this long below the threshold, nanoseconds.
const STANDSTILL_NS: i64 = 300_000_000;

/// The sensor with its errors.
#[derive(Debug, Clone)]
pub(crate) struct Wt901c {
    random: Random,
    gyro_noise: f64,
    accel_noise: f64,
    /// What is left in the data of a motion, rad/s.
    pub(crate) gyro_bias: Vector3<f64>,
    /// m/s^2.
    pub(crate) accel_bias: Vector3<f64>,
    auto_zero: bool,
    threshold: f64,
    sample_ns: i64,
    quiet_ns: i64,
}

impl Wt901c {
    pub(crate) fn new(config: &Config, mut random: Random) -> Self {
        let left = if config.auto_zero { config.auto_zero_residual } else { 1.0 };
        let gyro_bias = Vector3::from(random.normals()) * (config.gyro_bias_dps.to_radians() * left);
        let accel_bias = Vector3::from(random.normals()) * config.accel_bias_m_s2;
        // The square root of the rate against that which the noise is given for; exactly 1 there.
        let wider = (f64::from(config.imu_rate_hz) / 200.0).sqrt();
        Self {
            random,
            gyro_noise: config.gyro_noise_dps.to_radians() * wider,
            accel_noise: config.accel_noise_m_s2 * wider,
            gyro_bias,
            accel_bias,
            auto_zero: config.auto_zero,
            threshold: config.auto_zero_threshold_dps.to_radians(),
            // Switched on and calibrated before the walk starts, as its manual demands.
            sample_ns: config.sample_ns(),
            quiet_ns: STANDSTILL_NS,
        }
    }

    /// The words of the next sample: acceleration and angular velocity.
    pub(crate) fn measure(&mut self, motion: &Motion) -> ([i16; 3], [i16; 3]) {
        let accel_noise = Vector3::from(self.random.normals()) * self.accel_noise;
        let gyro_noise = Vector3::from(self.random.normals()) * self.gyro_noise;
        let accel = motion.specific_force() + self.accel_bias + accel_noise;
        let gyro = motion.angular_velocity + self.gyro_bias + gyro_noise;
        let scales = Scales::default();
        (scales.quantise_accel(accel.into()), scales.quantise_gyro(self.zeroed(gyro).into()))
    }

    /// At rest the firmware puts out exact zeros, and goes on doing so until a rate exceeds its threshold: the start of a
    /// slow turn after a standstill is hidden, small rates within a motion are not (reference logs of real devices).
    fn zeroed(&mut self, gyro: Vector3<f64>) -> Vector3<f64> {
        if !self.auto_zero {
            return gyro;
        }
        let quiet = gyro.amax() < self.threshold;
        self.quiet_ns = if quiet { (self.quiet_ns + self.sample_ns).min(STANDSTILL_NS) } else { 0 };
        if self.quiet_ns == STANDSTILL_NS { Vector3::zeros() } else { gyro }
    }
}

//! Configuration of [`super::Lio`].

use evac_stage::StageConfig;
use serde::{Deserialize, Serialize};

/// Configuration of the stage `lio`; the defaults are meant for a Mid-40 with a WT901C carried through a building.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LioConfig {
    /// White noise of the gyroscope, rad/s per sample at 200 Hz. Larger than the data sheet's 0.0014: it also
    /// carries scale and alignment errors.
    pub gyro_noise_rad_s: f64,
    /// White noise of the accelerometer, m/s^2 per sample at 200 Hz; as above (data sheet: 0.03). Values from 0.1 on
    /// lose decimetres at every corner.
    pub accel_noise_m_s2: f64,
    /// Random walk of the gyroscope's bias, rad/s per sqrt(s).
    pub gyro_bias_walk: f64,
    /// Random walk of the accelerometer's bias, m/s^2 per sqrt(s). Larger than the sensor's own (1e-5): a first turn
    /// that model errors spoil may split bias and tilt wrongly, and this lets the filter find out.
    pub accel_bias_walk: f64,
    /// Standard deviation of the gyroscope's bias where a standstill cannot show it, rad/s (0.4 degrees/s): a device
    /// with auto-zero reads exact zeros at rest.
    pub hidden_gyro_bias_rad_s: f64,
    /// Standard deviation of the gyroscope's scale error per axis; 0 holds it at zero.
    pub gyro_scale_sigma: f64,
    /// Standard deviation of the rotation between the IMU's true axes and those that `[rig.imu_from_lidar]` gives it,
    /// degrees per axis; 0 holds it at zero.
    pub misalignment_sigma_deg: f64,
    /// Expected scale error of the gyroscope per axis, from a calibration: a true rate `w` reads `(1 + scale) w`.
    pub gyro_scale: [f64; 3],
    /// Expected milliseconds to add to an IMU stamp to get LiDAR time, from a calibration.
    pub time_offset_ms: f64,
    /// Standard deviation of an unknown offset between the clocks of IMU and LiDAR, milliseconds; 0 holds it at zero.
    pub time_offset_sigma_ms: f64,
    /// Range noise of the LiDAR, metres (Mid-40 data sheet: 2 cm).
    pub range_noise_m: f64,
    /// Points closer than this are the rig or its bearer, metres.
    pub min_range_m: f64,
    /// Points farther than this are dropped, metres (Mid-40 data sheet: 260 m).
    pub max_range_m: f64,
    /// Standstill that the start waits for, seconds.
    pub standstill_s: f64,
    /// After so long without a standstill the odometry starts in motion with larger uncertainty, seconds.
    pub start_timeout_s: f64,
    /// One point in so many goes to the match; all go to the map.
    pub point_stride: u32,
    /// Ceiling of the map, cells of all levels (about 250 bytes each; the default is about 70 MB when full).
    pub max_cells: u32,
    /// Speed that the carrier cannot have, m/s: above it the odometry is lost.
    pub max_speed_m_s: f64,
}

impl Default for LioConfig {
    fn default() -> Self {
        Self {
            gyro_noise_rad_s: 0.003,
            accel_noise_m_s2: 0.06,
            gyro_bias_walk: 1e-6,
            accel_bias_walk: 1e-3,
            hidden_gyro_bias_rad_s: 0.007,
            gyro_scale_sigma: 0.003,
            misalignment_sigma_deg: 0.2,
            gyro_scale: [0.0; 3],
            time_offset_ms: 0.0,
            time_offset_sigma_ms: 3.0,
            range_noise_m: 0.02,
            min_range_m: 0.3,
            max_range_m: 260.0,
            standstill_s: 1.0,
            start_timeout_s: 3.0,
            point_stride: 4,
            max_cells: 1 << 18,
            max_speed_m_s: 3.0,
        }
    }
}

impl StageConfig for LioConfig {
    fn check(&self) -> Result<(), String> {
        let ranges = [
            ("gyro_noise_rad_s", self.gyro_noise_rad_s, 1e-5, 0.5),
            ("accel_noise_m_s2", self.accel_noise_m_s2, 1e-4, 5.0),
            ("gyro_bias_walk", self.gyro_bias_walk, 0.0, 0.1),
            ("accel_bias_walk", self.accel_bias_walk, 0.0, 1.0),
            ("hidden_gyro_bias_rad_s", self.hidden_gyro_bias_rad_s, 1e-5, 0.2),
            ("gyro_scale_sigma", self.gyro_scale_sigma, 0.0, 0.1),
            ("misalignment_sigma_deg", self.misalignment_sigma_deg, 0.0, 10.0),
            ("gyro_scale (x)", self.gyro_scale[0], -0.1, 0.1),
            ("gyro_scale (y)", self.gyro_scale[1], -0.1, 0.1),
            ("gyro_scale (z)", self.gyro_scale[2], -0.1, 0.1),
            ("time_offset_ms", self.time_offset_ms, -120.0, 120.0),
            ("time_offset_sigma_ms", self.time_offset_sigma_ms, 0.0, 50.0),
            ("range_noise_m", self.range_noise_m, 1e-3, 0.5),
            ("min_range_m", self.min_range_m, 0.0, 10.0),
            ("max_range_m", self.max_range_m, 1.0, 1000.0),
            ("standstill_s", self.standstill_s, 0.3, 30.0),
            ("start_timeout_s", self.start_timeout_s, 0.5, 60.0),
            ("point_stride", f64::from(self.point_stride), 1.0, 100.0),
            ("max_cells", f64::from(self.max_cells), 4096.0, 16_777_216.0),
            ("max_speed_m_s", self.max_speed_m_s, 0.5, 50.0),
        ];
        for (key, value, low, high) in ranges {
            if !(low..=high).contains(&value) {
                return Err(format!(
                    "{key} = {value} is outside {low} to {high}; leave the key out for the default"
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_hold_and_survive_a_file() {
        let config = LioConfig::default();
        assert_eq!(config.check(), Ok(()));
        assert_eq!(toml::from_str::<LioConfig>(&toml::to_string(&config).unwrap()).unwrap(), config);
    }

    #[test]
    fn unknown_keys_and_values_out_of_range_are_refused_by_name() {
        assert!(toml::from_str::<LioConfig>("max_cels = 5000").unwrap_err().to_string().contains("max_cels"));
        for value in [0.0, -1.0, f64::NAN] {
            let config = LioConfig { range_noise_m: value, ..LioConfig::default() };
            assert!(config.check().unwrap_err().contains("range_noise_m"));
        }
    }
}

//! What a simulated walk can be told, with every default in sight.

use std::path::PathBuf;

use evac_stage::StageConfig;
use serde::{Deserialize, Serialize};

use crate::world_kind::WorldKind;

/// Configuration of the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// The building.
    pub world: WorldKind,
    /// Measured point clouds (PCD, metres, z up) that `semi_real` is made of; all in one frame.
    pub clouds: Vec<PathBuf>,
    /// Places that the IMU passes in `semi_real`, in the clouds' frame, metres; at least 1 m apart. Points of the clouds
    /// within 0.7 m of the way are left out.
    pub way_points_m: Vec<[f64; 3]>,
    /// Which building of a kind that is drawn from a number; the other kinds stay as they are.
    pub building: u64,
    /// How far surfaces of plaster and stone are off ideal planes, root mean square in metres (floors, ceilings and pillars
    /// of concrete 0.4 of it, metal and wood nothing); where it is absent the world's own, 0 in all box worlds.
    pub roughness_m: Option<f64>,
    /// Seed of noise, biases and gait phases; the building and the route do not depend on it.
    pub seed: u64,
    /// Begins the data in mid-stride: the standstill at the start and the first 1.5 s of walking are left out.
    pub start_walking: bool,
    /// Times that the route is walked; after each the walker goes straight back to its start, so more than one is for routes that
    /// end near it: those of `corridor` and `hall`.
    pub laps: u32,
    /// Ends the walk early, seconds; the whole walk where it is absent.
    pub duration_s: Option<f64>,
    /// Walking speed on straight legs, m/s.
    pub speed_m_s: f64,
    /// Peak rate of turns on the spot, degrees/s.
    pub turn_rate_dps: f64,
    /// Scale of the gait: 1 is 2 cm of bob at 1.8 Hz with about 1 degree of roll, pitch and yaw; 0 is a trolley.
    pub gait: f64,
    /// Constant roll and pitch of the IMU while standing, degrees: nobody mounts it perfectly level.
    pub mount_tilt_deg: [f64; 2],
    /// Range noise along the beam, one sigma, metres (Mid-40 data sheet: 2 cm at 20 m).
    pub range_noise_m: f64,
    /// Share of shots without return although something was hit.
    pub drop_out_share: f64,
    /// Share of shots with a random range.
    pub stray_share: f64,
    /// Nothing nearer is measured, metres.
    pub min_range_m: f64,
    /// Nothing farther is measured, metres (Mid-40 data sheet: 90 m at 10 % reflectivity).
    pub max_range_m: f64,
    /// Samples of the IMU per second: a multiple of 10 that divides 1,000,000,000 (10 to 1000), so that frames begin and
    /// end with a sample. Noise per sample grows with the root of the rate, as of a sensor with that bandwidth.
    pub imu_rate_hz: u32,
    /// White noise of the gyroscope per 200 Hz sample, one sigma, degrees/s.
    pub gyro_noise_dps: f64,
    /// White noise of the accelerometer per 200 Hz sample, one sigma, m/s^2.
    pub accel_noise_m_s2: f64,
    /// Gyroscope bias, one sigma per axis over seeds, degrees/s; with `auto_zero` the firmware removes most of it.
    pub gyro_bias_dps: f64,
    /// Accelerometer bias, one sigma per axis over seeds, m/s^2.
    pub accel_bias_m_s2: f64,
    /// The real device's automatic zeroing: the gyroscope reads exactly zero at rest and hides slow starts.
    pub auto_zero: bool,
    /// Rates below this after a standstill are hidden by `auto_zero`, degrees/s (five real logs: 0.5 to 1); compared with
    /// what the sensor reads, so it must lie above noise and residual bias for zeros to appear.
    pub auto_zero_threshold_dps: f64,
    /// Share of the gyroscope bias that the firmware's zeroing leaves in the data of a motion.
    pub auto_zero_residual: f64,
    /// IMU clock minus LiDAR clock at the start, milliseconds. 0: one clock, as after a perfect clock fit.
    pub imu_clock_offset_ms: f64,
    /// Rate of the IMU clock against the LiDAR clock, parts per million. 0: one clock.
    pub imu_clock_ppm: f64,
    /// Folder that gets `lidar.pcap`, `wt901c.bin`, `truth.tum` and `rig.toml` while the walk runs; absent: no recording.
    pub record: Option<PathBuf>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            world: WorldKind::Corridor,
            clouds: Vec::new(),
            way_points_m: Vec::new(),
            building: 1,
            roughness_m: None,
            seed: 1,
            start_walking: false,
            laps: 1,
            duration_s: None,
            speed_m_s: 1.1,
            turn_rate_dps: 85.0,
            gait: 1.0,
            mount_tilt_deg: [0.6, -0.9],
            range_noise_m: 0.02,
            drop_out_share: 0.02,
            stray_share: 0.003,
            min_range_m: 0.3,
            max_range_m: 90.0,
            imu_rate_hz: 200,
            gyro_noise_dps: 0.08,
            accel_noise_m_s2: 0.03,
            gyro_bias_dps: 0.3,
            accel_bias_m_s2: 0.03,
            auto_zero: true,
            auto_zero_threshold_dps: 0.75,
            auto_zero_residual: 0.3,
            imu_clock_offset_ms: 0.0,
            imu_clock_ppm: 0.0,
            record: None,
        }
    }
}

impl StageConfig for Config {
    fn check(&self) -> Result<(), String> {
        let ranges = [
            ("laps", f64::from(self.laps), 1.0, 1000.0),
            ("duration_s", self.duration_s.unwrap_or(1.0), 0.1, 3600.0),
            ("roughness_m", self.roughness_m.unwrap_or(0.0), 0.0, 0.05),
            ("speed_m_s", self.speed_m_s, 0.1, 3.0),
            ("turn_rate_dps", self.turn_rate_dps, 5.0, 360.0),
            ("gait", self.gait, 0.0, 4.0),
            ("mount_tilt_deg (roll)", self.mount_tilt_deg[0], -45.0, 45.0),
            ("mount_tilt_deg (pitch)", self.mount_tilt_deg[1], -45.0, 45.0),
            ("range_noise_m", self.range_noise_m, 0.0, 1.0),
            ("drop_out_share", self.drop_out_share, 0.0, 1.0),
            ("stray_share", self.stray_share, 0.0, 1.0),
            ("min_range_m", self.min_range_m, 0.05, 10.0),
            ("max_range_m", self.max_range_m, 10.0, 1000.0),
            ("imu_rate_hz", f64::from(self.imu_rate_hz), 10.0, 1000.0),
            ("gyro_noise_dps", self.gyro_noise_dps, 0.0, 10.0),
            ("accel_noise_m_s2", self.accel_noise_m_s2, 0.0, 10.0),
            ("gyro_bias_dps", self.gyro_bias_dps, 0.0, 10.0),
            ("accel_bias_m_s2", self.accel_bias_m_s2, 0.0, 2.0),
            ("auto_zero_threshold_dps", self.auto_zero_threshold_dps, 0.0, 10.0),
            ("auto_zero_residual", self.auto_zero_residual, 0.0, 1.0),
            ("imu_clock_offset_ms", self.imu_clock_offset_ms, -1000.0, 1000.0),
            ("imu_clock_ppm", self.imu_clock_ppm, -1000.0, 1000.0),
        ];
        for (key, value, low, high) in ranges {
            if !(low..=high).contains(&value) {
                return Err(format!(
                    "{key} = {value} is outside {low} to {high}; leave it out for the default"
                ));
            }
        }
        self.check_clouds()?;
        if !self.imu_rate_hz.is_multiple_of(10) || !1_000_000_000_u32.is_multiple_of(self.imu_rate_hz) {
            return Err(format!(
                "imu_rate_hz = {} is not a multiple of 10 that divides 1,000,000,000; use 100, 200, 400, 500 or 1000",
                self.imu_rate_hz
            ));
        }
        Ok(())
    }
}

impl Config {
    fn check_clouds(&self) -> Result<(), String> {
        if self.world != WorldKind::SemiReal {
            return if self.clouds.is_empty() && self.way_points_m.is_empty() {
                Ok(())
            } else {
                Err("clouds and way_points_m belong to world = \"semi_real\"; leave them out or choose it"
                    .to_owned())
            };
        }
        if self.clouds.is_empty() || self.way_points_m.len() < 2 {
            return Err("world = \"semi_real\" needs clouds = [\"FILE.pcd\"] and at least two way_points_m"
                .to_owned());
        }
        let far = |pair: &[[f64; 3]]| {
            let way = [0, 1].map(|i| pair[1][i] - pair[0][i]);
            (1.0..10_000.0).contains(&way[0].hypot(way[1]))
                && (pair[1][2] - pair[0][2]).abs() < way[0].hypot(way[1])
        };
        match self.way_points_m.windows(2).find(|pair| !far(pair)) {
            Some(pair) => Err(format!(
                "way_points_m {:?} and {:?} must be finite, at least 1 m apart and not steeper than 45 degrees",
                pair[0], pair[1]
            )),
            None => Ok(()),
        }
    }

    /// The roughness that holds, metres.
    pub(crate) fn roughness(&self) -> f64 {
        self.roughness_m.unwrap_or(self.world.roughness_m())
    }

    /// Time between two IMU samples, nanoseconds.
    pub(crate) fn sample_ns(&self) -> i64 {
        1_000_000_000 / i64::from(self.imu_rate_hz.max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_valid_and_an_unknown_key_is_refused() {
        assert_eq!(Config::default().check(), Ok(()));
        assert_eq!(toml::from_str::<Config>("").unwrap(), Config::default());
        assert_eq!(toml::from_str::<Config>("world = \"hall\"").unwrap().world, WorldKind::Hall);
        assert!(toml::from_str::<Config>("sped_m_s = 1.0").is_err());
    }

    #[test]
    fn defaults_survive_toml() {
        let text = toml::to_string(&Config::default()).unwrap();
        assert_eq!(toml::from_str::<Config>(&text).unwrap(), Config::default());
    }

    #[test]
    fn a_value_out_of_range_is_named_with_its_range() {
        let error = Config { speed_m_s: f64::NAN, ..Config::default() }.check().unwrap_err();
        assert!(error.contains("speed_m_s") && error.contains("0.1 to 3"), "{error}");
        assert!(Config { gait: -1.0, ..Config::default() }.check().is_err());
    }

    #[test]
    fn measured_worlds_need_clouds_and_a_way_and_other_worlds_refuse_them() {
        let measured = |clouds: &[&str], way: &[[f64; 3]]| Config {
            world: WorldKind::SemiReal,
            clouds: clouds.iter().map(PathBuf::from).collect(),
            way_points_m: way.to_vec(),
            ..Config::default()
        };
        let way = [[0.0; 3], [5.0, 1.0, 0.2]];
        assert_eq!(measured(&["a.pcd"], &way).check(), Ok(()));
        assert!(measured(&[], &way).check().unwrap_err().contains("clouds"));
        assert!(measured(&["a.pcd"], &way[..1]).check().unwrap_err().contains("way_points_m"));
        for bad in [[0.5, 0.0, 0.0], [f64::NAN, 5.0, 0.0], [5.0, 0.0, 6.0]] {
            assert!(
                measured(&["a.pcd"], &[[0.0; 3], bad]).check().unwrap_err().contains("at least 1 m apart")
            );
        }
        let elsewhere = Config { world: WorldKind::Hall, ..measured(&["a.pcd"], &way) };
        assert!(elsewhere.check().unwrap_err().contains("semi_real"));
        let text = toml::to_string(&measured(&["a.pcd"], &way)).unwrap();
        assert_eq!(toml::from_str::<Config>(&text).unwrap(), measured(&["a.pcd"], &way));
    }

    #[test]
    fn only_rates_whose_samples_fall_on_the_borders_of_frames_are_taken() {
        for rate in [100, 200, 400, 500, 1000] {
            assert_eq!(Config { imu_rate_hz: rate, ..Config::default() }.check(), Ok(()));
        }
        for rate in [0, 30, 125, 2000] {
            assert!(
                Config { imu_rate_hz: rate, ..Config::default() }
                    .check()
                    .unwrap_err()
                    .contains("imu_rate_hz")
            );
        }
    }
}

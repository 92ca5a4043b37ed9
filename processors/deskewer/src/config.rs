//! What can be set.

use evac_stage::StageConfig;
use serde::{Deserialize, Serialize};

/// Configuration of the deskewer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DeskewerConfig {
    /// Deskew at all. Without, points pass as they came and the header says neither `DESKEWED` nor `IMU_MISSING`; an
    /// odometry must then cope with the motion inside the scan itself. For comparisons.
    pub enabled: bool,
    /// Nearer returns are dropped, metres: they come from the sensor's window, the rig and its carrier.
    pub min_range_m: f32,
    /// Farther returns are dropped, metres: the Mid-40's data sheet promises none beyond 260 m.
    pub max_range_m: f32,
    /// Start each frame from the odometry's pose, velocity and biases where there is one. Without, the
    /// rotation is as good after a standstill, but the velocity is mostly unknown.
    pub use_prior: bool,
    /// Oldest pose that is carried on to a frame by IMU data alone, seconds before the frame's start. After half a second
    /// even a poor tilt of 1 degree costs 9 cm/s, less than what is known without a pose.
    pub max_prior_age_s: f64,
    /// Time constant with which the own velocity is forgotten while no pose corrects it, seconds: a tilt
    /// of 1 degree then makes at most 0.17 m/s of false velocity, 17 mm within a frame.
    pub velocity_decay_s: f64,
    /// Longest interval without IMU samples that is bridged, seconds. A frame that meets a longer one is passed on
    /// as it came, marked `IMU_MISSING`.
    pub max_imu_gap_s: f64,
}

impl Default for DeskewerConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            min_range_m: 0.3,
            max_range_m: 260.0,
            use_prior: true,
            max_prior_age_s: 0.5,
            velocity_decay_s: 1.0,
            max_imu_gap_s: 0.1,
        }
    }
}

impl StageConfig for DeskewerConfig {
    fn check(&self) -> Result<(), String> {
        let ranges = [
            ("min_range_m", f64::from(self.min_range_m), 0.0, 100.0),
            ("max_range_m", f64::from(self.max_range_m), 0.1, 10_000.0),
            ("max_prior_age_s", self.max_prior_age_s, 0.0, 5.0),
            ("velocity_decay_s", self.velocity_decay_s, 0.01, 60.0),
            ("max_imu_gap_s", self.max_imu_gap_s, 0.001, 1.0),
        ];
        for (key, value, low, high) in ranges {
            if !(low..=high).contains(&value) {
                return Err(format!(
                    "{key} = {value} is not within {low} to {high}; leave it out for the default"
                ));
            }
        }
        if self.min_range_m >= self.max_range_m {
            return Err(format!(
                "min_range_m = {} is not below max_range_m = {}; every point would be dropped",
                self.min_range_m, self.max_range_m
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_in_range_and_survive_toml() {
        let config = DeskewerConfig::default();
        assert_eq!(config.check(), Ok(()));
        let text = toml::to_string(&config).unwrap();
        assert_eq!(toml::from_str::<DeskewerConfig>(&text).unwrap(), config);
        assert_eq!(toml::from_str::<DeskewerConfig>("").unwrap(), config);
    }

    #[test]
    fn bad_values_are_named_with_their_range() {
        let far = DeskewerConfig { min_range_m: 50.0, max_range_m: 20.0, ..Default::default() };
        assert!(far.check().unwrap_err().contains("min_range_m = 50"));
        let broken = DeskewerConfig { velocity_decay_s: f64::NAN, ..Default::default() };
        assert!(broken.check().unwrap_err().contains("velocity_decay_s = NaN is not within 0.01 to 60"));
        assert!(
            toml::from_str::<DeskewerConfig>("min_rnage_m = 1.0")
                .unwrap_err()
                .message()
                .contains("min_rnage_m")
        );
    }
}

//! Configuration of [`super::Loam`].

use evac_stage::StageConfig;
use serde::{Deserialize, Serialize};

/// Configuration of the stage `loam`; the defaults are meant for a Mid-40 carried through a building.
///
/// "Paper" is Lin and Zhang 2019 (Loam-Livox, arXiv 1909.06700).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LoamConfig {
    /// Points closer than this are the rig or its bearer, metres.
    pub min_range_m: f64,
    /// Points farther than this are dropped, metres (Mid-40 data sheet: 260 m).
    pub max_range_m: f64,
    /// Points that far from the optical axis are dropped, degrees (paper: 17 of the Mid-40's 19.2): there the scan line turns
    /// round and smoothness means nothing.
    pub max_deflection_deg: f64,
    /// Echoes weaker than this are dropped: reflectivity (0 to 255) over squared range, 1/m^2 (paper: 7e-3). A reflectivity of
    /// zero is taken for not measured.
    pub min_intensity: f64,
    /// Echoes stronger than this are dropped, 1/m^2: they saturate the receiver. The paper's 0.7 holds outdoors; it would
    /// drop every wall that is nearer than 12 m.
    pub max_intensity: f64,
    /// Least angle between beam and surface along the scan line, degrees (paper: 5).
    pub min_incidence_deg: f64,
    /// A point behind another is dropped where their ranges differ by this share (paper: 0.1): what hides it may have hidden the
    /// edge as well.
    pub occlusion_share: f64,
    /// A point nearer than this to the mean of its neighbours on the scan line is on a surface, metres (two sigma of the Mid-40).
    pub surface_smoothness_m: f64,
    /// A point farther than this from the mean of its neighbours is on an edge, metres (five sigma).
    pub edge_smoothness_m: f64,
    /// Surface points that go to the match; all go to the map.
    pub max_surface_features: u32,
    /// Edge points that go to the match; all go to the map.
    pub max_edge_features: u32,
    /// Edge of a voxel of the surface map, metres; each holds the mean of its points.
    pub surface_voxel_m: f64,
    /// Edge of a voxel of the edge map, metres.
    pub edge_voxel_m: f64,
    /// Voxels farther than this from the LiDAR are given up, metres.
    pub map_radius_m: f64,
    /// Voxels that were not seen over so long a way are given up, metres: the pose has drifted since, and a map of old and new
    /// walls side by side fits neither. (The original keeps the last 13 s.)
    pub map_way_m: f64,
    /// Ceiling of either map, voxels (about 100 bytes each).
    pub max_voxels: u32,
    /// Rounds of matching and optimising.
    pub iterations: u32,
    /// Share of the residuals, the largest, that is taken for outliers after two rounds (paper: 0.2).
    pub outlier_share: f64,
    /// Range noise of the LiDAR, metres (Mid-40 data sheet: 2 cm).
    pub range_noise_m: f64,
    /// With IMU: error of the angular velocity over a frame, rad/s: noise, bias and scale.
    pub gyro_error_rad_s: f64,
    /// With IMU: error of the acceleration over a frame, m/s^2: noise, bias and tilt.
    pub accel_error_m_s2: f64,
    /// Without IMU: change of the velocity that the constant-velocity model does not foresee, m/s^2.
    pub free_accel_m_s2: f64,
    /// Without IMU: change of the angular velocity that the model does not foresee, rad/s^2.
    pub free_turn_rad_s2: f64,
    /// Standstill that a start with IMU waits for, seconds.
    pub standstill_s: f64,
    /// After so long without a standstill the odometry starts in motion with larger uncertainty, seconds.
    pub start_timeout_s: f64,
    /// Speed that the carrier cannot have, m/s.
    pub max_speed_m_s: f64,
}

impl Default for LoamConfig {
    fn default() -> Self {
        Self {
            min_range_m: 0.3,
            max_range_m: 260.0,
            max_deflection_deg: 17.0,
            min_intensity: 7e-3,
            max_intensity: 1e3,
            min_incidence_deg: 5.0,
            occlusion_share: 0.1,
            surface_smoothness_m: 0.045,
            edge_smoothness_m: 0.1,
            max_surface_features: 1000,
            max_edge_features: 150,
            surface_voxel_m: 0.3,
            edge_voxel_m: 0.2,
            map_radius_m: 50.0,
            map_way_m: 30.0,
            max_voxels: 1 << 16,
            iterations: 6,
            outlier_share: 0.2,
            range_noise_m: 0.02,
            gyro_error_rad_s: 0.004,
            accel_error_m_s2: 0.1,
            free_accel_m_s2: 3.0,
            free_turn_rad_s2: 3.0,
            standstill_s: 1.0,
            start_timeout_s: 3.0,
            max_speed_m_s: 2.5,
        }
    }
}

impl StageConfig for LoamConfig {
    fn check(&self) -> Result<(), String> {
        let ranges = [
            ("min_range_m", self.min_range_m, 0.0, 10.0),
            ("max_range_m", self.max_range_m, 1.0, 1000.0),
            ("max_deflection_deg", self.max_deflection_deg, 1.0, 180.0),
            ("min_intensity", self.min_intensity, 0.0, 1.0),
            ("max_intensity", self.max_intensity, 0.1, 1e6),
            ("min_incidence_deg", self.min_incidence_deg, 0.0, 45.0),
            ("occlusion_share", self.occlusion_share, 0.01, 1.0),
            ("surface_smoothness_m", self.surface_smoothness_m, 1e-3, 1.0),
            ("edge_smoothness_m", self.edge_smoothness_m, 1e-3, 5.0),
            ("max_surface_features", f64::from(self.max_surface_features), 50.0, 8192.0),
            ("max_edge_features", f64::from(self.max_edge_features), 0.0, 8192.0),
            ("surface_voxel_m", self.surface_voxel_m, 0.05, 5.0),
            ("edge_voxel_m", self.edge_voxel_m, 0.05, 5.0),
            ("map_radius_m", self.map_radius_m, 5.0, 1000.0),
            ("map_way_m", self.map_way_m, 1.0, 1e5),
            ("max_voxels", f64::from(self.max_voxels), 1024.0, 16_777_216.0),
            ("iterations", f64::from(self.iterations), 3.0, 50.0),
            ("outlier_share", self.outlier_share, 0.0, 0.5),
            ("range_noise_m", self.range_noise_m, 1e-3, 0.5),
            ("gyro_error_rad_s", self.gyro_error_rad_s, 1e-5, 1.0),
            ("accel_error_m_s2", self.accel_error_m_s2, 1e-4, 10.0),
            ("free_accel_m_s2", self.free_accel_m_s2, 0.01, 100.0),
            ("free_turn_rad_s2", self.free_turn_rad_s2, 0.01, 100.0),
            ("standstill_s", self.standstill_s, 0.3, 30.0),
            ("start_timeout_s", self.start_timeout_s, 0.5, 60.0),
            ("max_speed_m_s", self.max_speed_m_s, 0.5, 50.0),
        ];
        for (key, value, low, high) in ranges {
            if !(low..=high).contains(&value) {
                return Err(format!(
                    "{key} = {value} is outside {low} to {high}; leave the key out for the default"
                ));
            }
        }
        if self.surface_smoothness_m > self.edge_smoothness_m {
            return Err(format!(
                "surface_smoothness_m = {} is above edge_smoothness_m = {}; a point would be both",
                self.surface_smoothness_m, self.edge_smoothness_m
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_hold_and_survive_a_file() {
        let config = LoamConfig::default();
        assert_eq!(config.check(), Ok(()));
        assert_eq!(toml::from_str::<LoamConfig>(&toml::to_string(&config).unwrap()).unwrap(), config);
    }

    #[test]
    fn unknown_keys_and_values_out_of_range_are_refused_by_name() {
        assert!(
            toml::from_str::<LoamConfig>("iteratoins = 5").unwrap_err().to_string().contains("iteratoins")
        );
        for value in [0.0, -1.0, f64::NAN] {
            let config = LoamConfig { range_noise_m: value, ..LoamConfig::default() };
            assert!(config.check().unwrap_err().contains("range_noise_m"));
        }
        let both = LoamConfig { surface_smoothness_m: 0.5, ..LoamConfig::default() };
        assert!(both.check().unwrap_err().contains("surface_smoothness_m"));
    }
}

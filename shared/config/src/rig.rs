//! The rig: where the sensors sit. Extrinsics live here once and nowhere else.

use std::path::Path;

use evac_geometry::nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use crate::ConfigError;

/// The `[rig]` table of a pipeline file, or a rig file of its own.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// LiDAR to IMU coordinates.
    #[serde(default)]
    pub imu_from_lidar: ImuFromLidar,
}

/// `[rig.imu_from_lidar]`: the paper's Eq. 1-3 from a lever arm and Euler angles.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImuFromLidar {
    /// Origin of the LiDAR in the IMU frame, metres.
    #[serde(default)]
    pub translation_m: [f64; 3],
    /// Roll, pitch and yaw in degrees; `R = Rz(yaw) Ry(pitch) Rx(roll)`.
    #[serde(default)]
    pub roll_pitch_yaw_deg: [f64; 3],
}

impl Rig {
    /// The transform from LiDAR to IMU coordinates.
    pub fn imu_from_lidar(&self) -> Isometry3<f64> {
        let ImuFromLidar { translation_m, roll_pitch_yaw_deg } = self.imu_from_lidar;
        evac_geometry::imu_from_lidar(translation_m, roll_pitch_yaw_deg)
    }

    pub(crate) fn check(&self) -> Result<(), String> {
        let ImuFromLidar { translation_m, roll_pitch_yaw_deg } = self.imu_from_lidar;
        if !translation_m.iter().all(|t| t.is_finite() && t.abs() <= 10.0) {
            return Err(format!(
                "rig.imu_from_lidar.translation_m = {translation_m:?} must be finite metres, at most 10"
            ));
        }
        if !roll_pitch_yaw_deg.iter().all(|a| a.is_finite() && a.abs() <= 360.0) {
            return Err(format!(
                "rig.imu_from_lidar.roll_pitch_yaw_deg = {roll_pitch_yaw_deg:?} must be degrees within +-360"
            ));
        }
        Ok(())
    }
}

/// A rig file: one `[rig]` table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigFile {
    /// The rig.
    pub rig: Rig,
}

impl RigFile {
    /// Reads a rig file.
    ///
    /// # Errors
    /// [`ConfigError`] with the place in the file.
    pub fn read(path: &Path) -> Result<Rig, ConfigError> {
        Self::parse(path, &ConfigError::read(path)?)
    }

    fn parse(path: &Path, text: &str) -> Result<Rig, ConfigError> {
        let file: Self = toml::from_str(text).map_err(|cause| ConfigError::toml(path, text, &cause))?;
        file.rig.check().map_err(|cause| ConfigError::value(path, cause))?;
        Ok(file.rig)
    }
}

#[cfg(test)]
mod tests {
    use evac_geometry::nalgebra::{Point3, Vector3};

    use super::*;

    fn parse(text: &str) -> Result<Rig, ConfigError> {
        RigFile::parse(Path::new("rig.toml"), text)
    }

    #[test]
    fn a_rig_file_gives_the_transform_from_lidar_to_imu() {
        let text = "[rig.imu_from_lidar]\ntranslation_m = [0.1, 0.0, 0.0]\nroll_pitch_yaw_deg = [0, 0, 90]\n";
        let imu = parse(text).unwrap().imu_from_lidar() * Point3::new(1.0, 0.0, 0.0);
        assert!((imu.coords - Vector3::new(0.1, 1.0, 0.0)).norm() < 1e-12, "{imu}");
        assert_eq!(parse("[rig]").unwrap(), Rig::default());
    }

    #[test]
    fn a_rig_file_with_a_missing_table_an_unknown_key_or_a_value_out_of_range_is_refused_by_name() {
        for (text, word) in [
            ("", "missing field `rig`"),
            ("[rig.imu_from_lidar]\ntranslation_mm = [1.0, 0.0, 0.0]", "line 2"),
            ("[rig.imu_from_lidar]\ntranslation_m = [100.0, 0.0, 0.0]", "at most 10"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.starts_with("rig.toml: ") && error.contains(word), "{text}: {error}");
        }
        let error = RigFile::read(Path::new("no/such/rig.toml")).unwrap_err().to_string();
        assert!(error.starts_with("no/such/rig.toml: "), "{error}");
    }
}

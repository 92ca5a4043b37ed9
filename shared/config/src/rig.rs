//! The rig: where the sensors sit. Extrinsics live here once and nowhere else.

use evac_geometry::nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

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
}

//! Rigid motions, the rig's extrinsic, interpolation and IMU integration. Pure mathematics: no IPC, no clock.
//!
//! A transform `map_from_lidar` takes LiDAR coordinates to map coordinates, so products read from right to left:
//! `map_from_imu * imu_from_lidar = map_from_lidar`.

mod extrinsic;
mod gyro_scale;
mod imu_conditioning;
mod imu_integration;
mod pose;
mod standstill;

pub use extrinsic::{imu_from_lidar, rotation_from_euler};
pub use gyro_scale::{GyroScale, GyroScaleCheck};
pub use imu_conditioning::{Conditioned, ImuConditioner};
pub use imu_integration::{ImuCoverage, ImuIntegrator, ImuState};
pub use nalgebra;
pub use pose::{
    Interpolation, exp_so3, interpolate, isometry, log_so3, map_from_imu, map_from_lidar, set_map_from_imu,
    set_map_from_lidar, skew,
};
pub use standstill::{MotionState, Standstill, StandstillDetector, StandstillLimits};

/// Standard gravity, m/s^2 (CGPM 1901); the norm every estimate of gravity is held to.
pub const STANDARD_GRAVITY: f64 = 9.806_65;

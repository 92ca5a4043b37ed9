//! Decoding of the ROS 1 messages that hold LiDAR and IMU data: little-endian, no padding, no copy.

mod custom_msg;
mod imu;
mod point_cloud2;
mod wire;

pub use custom_msg::{CustomMsg, CustomPoint};
pub use imu::Imu;
pub use point_cloud2::{CloudPoint, PointCloud2, TimeUnit};
pub use wire::{Header, MessageError};

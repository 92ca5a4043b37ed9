//! The ROS messages that hold LiDAR data, IMU data, poses and grids, as ROS 1 and ROS 2 serialise them: read without a copy,
//! written into a buffer that is kept.

mod custom_msg;
mod diagnostics;
mod grid;
mod imu;
mod octets;
mod octomap;
mod point_cloud2;
mod pose;
pub mod schemas;
mod wire;
mod writer;

pub use custom_msg::{CustomMsg, CustomPoint, write_custom_msg};
pub use diagnostics::{Level, write_diagnostics};
pub use grid::{Grid, write_grid};
pub use imu::{Imu, write_imu};
pub use octets::{octets, write_octets};
pub use octomap::{Octomap, write_octomap};
pub use point_cloud2::{CloudField, CloudPoint, Datatype, PointCloud2, TimeUnit, write_cloud};
pub use pose::{RosPose, write_odometry, write_pose, write_transform};
pub use wire::{Encoding, Header, MessageError};
pub use writer::{Stamp, Writer};

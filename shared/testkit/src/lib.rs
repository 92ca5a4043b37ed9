//! What tests share.

mod allocations;
mod data;
mod ros;

pub use allocations::{CountingAllocator, count_allocations};
pub use data::{data, unpacked};
pub use ros::ros_libraries;

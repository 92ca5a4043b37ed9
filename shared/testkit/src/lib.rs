//! What tests share.

mod allocations;
mod data;
mod killed;
mod ros;

pub use allocations::{CountingAllocator, count_allocations};
pub use data::{data, unpacked};
pub use killed::{folder_of_killed, kill_while_writing};
pub use ros::ros_libraries;

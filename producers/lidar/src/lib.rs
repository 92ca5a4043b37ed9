//! The driver of a Livox LiDAR: Mid-40, Mid-70, Mid-100, Avia, Horizon and Tele-15 by the first wire protocol, Mid-360 and
//! HAP by the second.
//!
//! The conversation with the device (`session`), the following of its clock (`timeline`) and the putting together of scans
//! (`assembly`) know neither sockets nor clocks. [`Lidar`] drives them: packets are received in batches to where they stay
//! until their scan is complete (`intake`), and are then decoded straight into shared memory.

mod assembly;
mod condition;
mod config;
mod counts;
mod driver;
mod intake;
mod own_imu;
mod packet;
mod points;
mod rate;
mod receive;
mod session;
mod sockets;
mod store;
mod timeline;

pub use config::{Config, Protocol, ReturnMode};
pub use counts::PacketCounts;
pub use driver::Lidar;

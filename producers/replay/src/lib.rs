//! Replays recordings: packets of a Livox device (pcap of either protocol, LVX, LVX2) with a WT901C byte log or the device's
//! own IMU, or a bag (ROS 1, ROS 2 as MCAP or db3, evac's own recorder).
//!
//! A recording is gone over once when it is opened, so that what is wrong with it is said before anything starts and
//! the number of scans is known. It is then streamed by two readers of the file, one for each sensor, and joined by the
//! time of measuring; how the streams are interleaved in the file does not matter, and memory holds one scan.

mod bag;
mod capture;
mod config;
mod imu_log;
mod source;
mod streams;

pub use config::{Config, GyroUnit, ImuUnit};
pub use source::Replay;

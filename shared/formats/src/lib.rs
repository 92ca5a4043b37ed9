//! File and wire formats: bytes in, typed values out, and back. No IPC, no clock. No parser panics on any bytes.

mod atomic_file;
pub mod bag;
pub mod cloud;
mod error;
pub mod las;
mod lines;
pub mod livox_sdk1;
pub mod livox_sdk2;
pub mod lvx;
pub mod mcap;
pub mod occupancy_grid;
pub mod octomap;
pub mod pcap;
pub mod pcd;
pub mod pfm;
pub mod ply;
pub mod rgb_image;
pub mod ros;
pub mod rosbag;
mod sqlite;
pub mod tum;
mod utc;
pub mod wt901c;

pub use atomic_file::{write_atomically, write_for_this_boot};
pub use error::FormatError;
pub use utc::name as utc_name;

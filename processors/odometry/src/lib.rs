//! Where the LiDAR is: odometry stages.
//!
//! [`Lio`] (stage `lio`) couples IMU and LiDAR tightly: an iterated error-state Kalman filter whose measurement is the
//! distance of single points to planes of a multi-level voxel map. No feature extraction, no down-sampled scans.
//!
//! The corner is the one hard place: a 38-degree cone in front of a blank wall leaves two translations and the roll
//! about the viewing axis unobserved. The filter is given honest information there (inflated point noise, each plane's
//! own error counted once), never inverts it, and so leaves the unobserved directions to the IMU and says which they are.

//!
//! [`Loam`] (stage `loam`) is the method of the paper: edge and surface features of Loam-Livox matched with a local map, on
//! scans that were deskewed by the IMU or, for comparison, on raw ones.

mod follow;
mod lio;
mod loam;

pub use lio::{Diagnostics, Lio, LioConfig, ScanOrientation};
pub use loam::{Loam, LoamConfig, LoamDiagnostics};

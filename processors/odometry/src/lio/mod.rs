//! The stage `lio`: see [`Lio`].
//!
//! A frame's way: [`stage`] takes it in and waits for the start ([`initialisation`], [`batch_means`], [`glide`]); then [`tracking`] carries the
//! [`filter`] on by the IMU ([`imu`], [`propagation`], [`habit`]), brings points to the frame's end where that was not done ([`deskew`]), matches
//! them with planes ([`matching`], [`plane_map`], [`voxel`], [`cell`]), corrects ([`correction`], [`joint`]), says what was not observed
//! ([`degeneracy`]), judges and maps ([`mapping`], [`monitor`], [`settling`], [`sections`]), and reports ([`report`]). The offset between the
//! clocks is searched for meanwhile ([`scout`], [`offset_search`]), and the way since the start taken again with it ([`retake`]). A standby follows another odometry instead ([`follow`]).
//!
//! Mathematics: iterated error-state Kalman filter after Xu et al. 2022 (FAST-LIO2), voxel planes with their uncertainty
//! after Yuan et al. 2022 (VoxelMap), in the information form of [`correction`] that inverts neither prior nor information.

mod approach;
mod batch_means;
mod cell;
mod config;
mod correction;
mod degeneracy;
mod deskew;
mod drift;
mod filter;
mod follow;
mod glide;
mod habit;
mod imu;
mod information;
mod initialisation;
mod joint;
mod mapping;
mod matching;
mod monitor;
mod offset;
mod offset_search;
mod orientation;
mod plane_map;
mod propagation;
mod report;
mod retake;
mod scout;
mod sections;
mod settling;
mod stage;
mod state;
mod tracking;
mod voxel;

pub use config::LioConfig;
pub use orientation::ScanOrientation;
pub use stage::{Diagnostics, Lio};

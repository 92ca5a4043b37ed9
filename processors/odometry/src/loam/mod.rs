//! The stage `loam`: see [`Loam`].
//!
//! A frame's way: [`stage`] takes it in and waits for the start ([`start`]); [`features`] chooses good points and finds edges
//! and surfaces; then [`tracking`] carries the [`filter`] on ([`motion`]), matches features with the local map
//! ([`registration`], [`sweep`], [`shape`], [`centroid_map`], [`nearest`]), leaves out what was not observed ([`observability`]), judges
//! ([`monitor`], [`settling`]), maps, and reports ([`report`]).
//!
//! Mathematics: Lin and Zhang 2019 (Loam-Livox) for features, matching, outlier rejection and motion inside the frame; Zhang, Kaess
//! and Singh 2016 for degenerate directions. A scan that was deskewed by the IMU is matched as it is, with the IMU's motion as
//! prior; one that was not is matched as the original does it: constant velocity, points moved along with the pose that is
//! sought, and nothing from the IMU.

mod centroid_map;
mod config;
mod features;
mod filter;
mod follow;
mod monitor;
mod motion;
mod nearest;
mod observability;
mod registration;
mod report;
mod settling;
mod shape;
mod stage;
mod start;
mod sweep;
mod tracking;

pub use config::LoamConfig;
pub use stage::{Loam, LoamDiagnostics};

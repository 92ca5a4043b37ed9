//! The stage `lio`: see [`Lio`].

mod cell;
mod config;
mod correction;
mod degeneracy;
mod deskew;
mod filter;
mod imu;
mod initialisation;
mod matching;
mod monitor;
mod plane_map;
mod propagation;
mod report;
mod settling;
mod stage;
mod state;
mod tracking;

pub use config::LioConfig;
pub use stage::{Diagnostics, Lio};

//! Walks that never happened: buildings smooth and rough, a Livox Mid-40 and a WIT Motion WT901C, with the truth.
//!
//! ```
//! use evac_simulator::{Config, simulate};
//!
//! let config = Config { seed: 7, duration_s: Some(0.5), ..Config::default() };
//! let frames: Vec<_> = simulate(&config, &evac_stage::Rig::default())?.collect();
//! assert_eq!((frames.len(), frames[0].points.len(), frames[0].imu.len()), (5, 10_000, 21));
//! # Ok::<(), evac_stage::StageError>(())
//! ```

mod catalogue;
mod config;
pub mod devices;
mod mid40;
mod random;
mod recording;
mod source;
mod trajectory;
mod walk;
mod world;
mod world_kind;
mod wt901c;

pub use catalogue::{CatalogueWalk, Group, catalogue, semi_real};
pub use config::Config;
pub use mid40::{FIELD_OF_VIEW_DEG, SHOT_NS, direction};
pub use random::Random;
pub use source::Simulator;
pub use walk::{FRAME_NS, Frame, Frames, Walk, simulate};
pub use world_kind::WorldKind;
pub use wt901c::SAMPLE_NS;

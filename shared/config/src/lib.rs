//! Pipeline files and rig files (TOML), parsed into types that cannot hold nonsense.

mod error;
mod pipeline;
mod rig;
mod supervision;

pub use error::ConfigError;
pub use pipeline::{Mode, Pipeline, StageEntry};
pub use rig::{ImuFromLidar, Rig, RigFile};
pub use supervision::{Scheduling, Supervision};

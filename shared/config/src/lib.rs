//! Pipeline files and rig files (TOML), parsed into types that cannot hold nonsense.

mod rig;

pub use rig::{ImuFromLidar, Rig};

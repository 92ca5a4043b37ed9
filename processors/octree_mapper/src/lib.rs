//! Joins deskewed scans with their poses, filters them (paper section 3.1) and keeps the global map of key frames in an
//! octree with OctoMap's semantics (paper section 3.2, Eq. 7-10).

mod bounds;
mod check;
mod cloud;
mod config;
mod filter_config;
mod ground;
mod key_frame;
mod mapper;
mod memory;
mod outliers;
#[cfg(test)]
mod synthetic;
mod unseen;

pub use cloud::{
    CloudFilter, CloudFilterConfig, CloudFilterError, CloudMap, CloudOutlierConfig, CloudSource, Removed,
    Verdict, map_of_cloud,
};
pub use config::{KeyFrameConfig, OccupancyConfig, OctreeMapperConfig};
pub use filter_config::{BoundsConfig, GroundConfig, OutlierConfig};
pub use ground::GroundFilter;
pub use key_frame::KeyFrames;
pub use mapper::OctreeMapper;
pub use outliers::RadiusOutlierFilter;
pub use unseen::{UnseenAction, UnseenConfig};

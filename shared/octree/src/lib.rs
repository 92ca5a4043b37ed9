//! A sparse voxel map with OctoMap's exact semantics: same keys, same rays, same `f32` log-odds, same files.
//!
//! The map is [`OctreeMap`]. Inside it is no octree: voxels of the finest level live in bricks of 8 x 8 x 8, found
//! through a hash table and numbered in Morton order, which is the order of an octree's leaves. The tree with its inner
//! nodes is built only for files ([`OctreeMap::to_tree`]). All points are `f32` metres in the map frame.
//!
//! Occupancy after the scans z_1 to z_t (the paper's Eq. 7 to 10, section 2.4) is kept as log-odds, where Bayes' rule
//! is an addition; see [`SensorModel`].

mod apply;
mod bricks;
mod cast;
mod changes;
mod coarse;
mod decoded;
mod directory;
mod error;
mod forget;
mod key;
mod leaves;
mod map;
mod marks;
mod mask;
mod merge;
mod morton;
mod numbers;
mod palette;
mod planes;
mod rays;
mod region;
mod scan;
mod sensor;
mod since;
mod store;
mod trace;
mod tree;
mod units;
mod voxels;
mod window;

pub use cast::RayCast;
pub use changes::Changes;
pub use error::{MapError, Rejected};
pub use evac_formats::octomap::OcTreeFile;
pub use key::{Key, KeySpace};
pub use leaves::Leaf;
pub use map::{MapConfig, OctreeMap};
pub use merge::MergeReport;
pub use scan::{Bounds, Scan, ScanOptions, ScanReport};
pub use sensor::{Occupancy, Probabilities, SensorModel};
pub use since::Revision;
pub use tree::Pruning;
pub use voxels::Voxels;

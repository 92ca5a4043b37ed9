//! A sparse voxel map with OctoMap's exact semantics: same keys, same rays, same `f32` log-odds, same files.
//!
//! The map is [`OctreeMap`]. Inside it is no octree: voxels of the finest level live in bricks of 8 x 8 x 8, found
//! through a directory of tiles and numbered in Morton order, which is the order of an octree's leaves. A tree with its
//! inner nodes is built only where one is asked for ([`OctreeMap::to_tree`]). All points are `f32` metres in the map frame.
//!
//! - A voxel is kept as the number of its exact value. A brick has as many bit planes as its numbers need (2 to 7, or 16),
//!   and none where all its voxels are equal; an update works on all equal voxels of a word at once.
//! - A scan marks voxels in bit masks, one per brick of the box that it reaches, so every voxel is updated once and the
//!   order of the points means nothing. Rays are walked many side by side.
//! - Threads ([`MapConfig::threads`]) share the rays of a scan, and then its bricks; the map is the same with any number.
//!
//! What can be asked: single voxels ([`OctreeMap::log_odds`]), all voxels ([`OctreeMap::voxels`]), leaves at any depth
//! ([`OctreeMap::for_each_leaf`]) and in a box ([`OctreeMap::for_each_leaf_in`]), rays ([`OctreeMap::cast_ray`]), the last
//! scan's changes ([`OctreeMap::changes`]) and those since a moment ([`OctreeMap::for_each_changed_since`]). What can be
//! taken out: a box, all but a box, what was not seen again ([`OctreeMap::forget_unseen`], [`OctreeMap::fade_unseen`]).
//! Two maps can be merged ([`OctreeMap::merge`]).
//!
//! Files are OctoMap's, byte for byte: [`OctreeMap::ot_bytes`], [`OctreeMap::bt_bytes`], [`OctreeMap::read`]. Memory has a ceiling
//! ([`MapConfig::max_bytes`]): from seven eighths of it on no new place is taken in, and what is in the map keeps being updated.
//! Errors are [`MapError`] for maps that cannot be, [`ReadError`] for files, [`Rejected`] for single voxels; a scan counts what it
//! drops ([`ScanReport`]).
//!
//! ```
//! use evac_octree::{MapConfig, Occupancy, OctreeMap, Scan, ScanOptions};
//!
//! let mut map = OctreeMap::new(MapConfig::new(0.1))?;
//! let scan = Scan { origin: [0.0; 3], hits: &[[2.05, 0.0, 0.0]], ..Scan::default() };
//! let report = map.insert_scan(&scan, &ScanOptions::default());
//! assert_eq!((report.free_voxels, report.occupied_voxels), (20, 1));
//! let wall = map.cast_ray([0.0; 3], [1.0, 0.0, 0.0], false, Some(10.0)).filter(|ray| ray.hit);
//! assert!(wall.is_some_and(|ray| (ray.end[0] - 2.05).abs() < 1e-5));
//! # Ok::<(), evac_octree::MapError>(())
//! ```
//!
//! Occupancy after the scans z_1 to z_t (the paper's Eq. 7 to 10, section 2.4) is kept as log-odds, where Bayes' rule
//! is an addition; see [`SensorModel`].

mod apply;
mod binary;
mod bricks;
mod build;
mod cast;
mod changes;
mod coarse;
mod count;
mod decoded;
mod directory;
mod error;
mod forget;
mod key;
mod lanes;
mod leaves;
mod map;
mod marks;
mod mask;
mod merge;
mod message;
mod morton;
mod numbers;
mod palette;
mod planes;
mod rays;
mod read;
mod region;
mod scan;
mod sensor;
mod since;
mod skip;
mod store;
mod trace;
mod tree;
mod units;
mod voxels;
mod window;

pub use cast::RayCast;
pub use changes::Changes;
pub use error::{MapError, ReadError, Rejected};
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

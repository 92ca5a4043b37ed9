//! Whole clouds, as `evac convert` reads them: no scans, no sensor positions, any number of points.
//!
//! The points are not kept. A filter that must know the surroundings of a point reads the cloud more than once and keeps
//! what it needs by places: [`CloudFilter`] has how.

mod counts;
mod filter;
mod undecided;

use std::convert::Infallible;

use evac_octree::{MapConfig, MapError, OctreeMap, Rejected};

pub use filter::{CloudFilter, CloudFilterConfig, CloudFilterError, CloudOutlierConfig, Removed, Verdict};

/// A cloud that can be read from the start as often as needed, each time with the same points in the same order; metres,
/// z against gravity.
pub trait CloudSource {
    /// Why it cannot be read.
    type Error;

    /// Calls `visit` with every point, finite or not.
    ///
    /// # Errors
    /// Where the cloud cannot be read.
    fn each(&mut self, visit: impl FnMut([f32; 3])) -> Result<(), Self::Error>;
}

impl CloudSource for &[[f32; 3]] {
    type Error = Infallible;

    fn each(&mut self, visit: impl FnMut([f32; 3])) -> Result<(), Infallible> {
        self.iter().copied().for_each(visit);
        Ok(())
    }
}

/// A map made of a cloud, and the points that did not go into it.
#[derive(Debug)]
pub struct CloudMap {
    /// The octree.
    pub map: OctreeMap,
    /// Points that went in.
    pub hits: u64,
    /// Points dropped because a coordinate was not finite.
    pub not_finite: u64,
    /// Points dropped because they lie beyond the key space (32,768 voxels each way).
    pub outside: u64,
    /// Points dropped because the map was full.
    pub full: u64,
}

impl CloudMap {
    /// An empty one.
    ///
    /// # Errors
    /// A map configuration that does not hold together.
    pub fn new(config: MapConfig) -> Result<Self, MapError> {
        Ok(Self { map: OctreeMap::new(config)?, hits: 0, not_finite: 0, outside: 0, full: 0 })
    }

    /// One hit and no ray, as OctoMap's `updateNode(point, true)`.
    pub fn hit(&mut self, point: [f32; 3]) {
        match self.map.update_node(point, true) {
            Ok(_) => self.hits += 1,
            Err(refused) => self.count(refused),
        }
    }

    /// A point of the ground: its voxel gets the ground flag, which is for flat maps and in no octree file.
    pub fn ground(&mut self, point: [f32; 3]) {
        let Some(key) = self.map.space().key(point) else { return self.count(Rejected::OutsideKeySpace) };
        if let Err(refused) = self.map.set_ground(key) {
            self.count(refused);
        }
    }

    fn count(&mut self, refused: Rejected) {
        match refused {
            Rejected::NotFinite => self.not_finite += 1,
            Rejected::OutsideKeySpace => self.outside += 1,
            Rejected::Full => self.full += 1,
        }
    }
}

/// One hit a point and no rays, as OctoMap's `updateNode(point, true)`; points in metres.
///
/// # Errors
/// A map configuration that does not hold together.
pub fn map_of_cloud(
    points: impl IntoIterator<Item = [f32; 3]>,
    config: MapConfig,
) -> Result<CloudMap, MapError> {
    let mut cloud = CloudMap::new(config)?;
    points.into_iter().for_each(|point| cloud.hit(point));
    Ok(cloud)
}

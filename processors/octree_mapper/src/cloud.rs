//! Whole clouds, as `evac convert` reads them: no scans, no sensor positions.

use evac_octree::{MapConfig, MapError, OctreeMap, Rejected};

use crate::{GroundConfig, GroundFilter};

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

/// One hit a point and no rays, as OctoMap's `updateNode(point, true)`; points in metres.
///
/// # Errors
/// A map configuration that does not hold together.
pub fn map_of_cloud(
    points: impl IntoIterator<Item = [f32; 3]>,
    config: MapConfig,
) -> Result<CloudMap, MapError> {
    let mut cloud = CloudMap { map: OctreeMap::new(config)?, hits: 0, not_finite: 0, outside: 0, full: 0 };
    for point in points {
        match cloud.map.update_node(point, true) {
            Ok(_) => cloud.hits += 1,
            Err(Rejected::NotFinite) => cloud.not_finite += 1,
            Err(Rejected::OutsideKeySpace) => cloud.outside += 1,
            Err(Rejected::Full) => cloud.full += 1,
        }
    }
    Ok(cloud)
}

/// Removes the ground of all levels from a cloud whose z is against gravity; returns how many points were removed.
/// The others keep their order. Points are in metres; those that are not finite stay, for the caller to count.
///
/// # Errors
/// One sentence about a configuration value out of range.
pub fn remove_ground(points: &mut Vec<[f32; 3]>, config: &GroundConfig) -> Result<usize, String> {
    config.check()?;
    let before = points.len();
    let mut filter = GroundFilter::new(*config, before);
    let mut ground = filter.ground_of_cloud(points).iter();
    points.retain(|_| ground.next() == Some(&false));
    Ok(before - points.len())
}

//! Rays through the finished map.

use crate::morton::{self, BRICK_BITS};
use crate::trace::{HalfVoxel, Walk, norm};
use crate::{Occupancy, OctreeMap};

/// Where a ray through the map ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayCast {
    /// Whether an occupied voxel stopped it. Otherwise it was an unknown one, the range or the edge of the key space.
    pub hit: bool,
    /// Centre of the last voxel, metres in the map frame.
    pub end: [f32; 3],
}

impl OctreeMap {
    /// Follows a ray until it meets an occupied voxel: OctoMap's `castRay`, voxel for voxel. `direction` need not be a
    /// unit vector. Stops at unknown voxels unless `through_unknown`, and where the voxel's centre is farther than
    /// `max_range` metres from the origin. `None` where the origin has no key or the direction no length.
    pub fn cast_ray(
        &self,
        origin: [f32; 3],
        direction: [f32; 3],
        through_unknown: bool,
        max_range: Option<f64>,
    ) -> Option<RayCast> {
        let key = self.space().key(origin)?;
        let start = |hit| Some(RayCast { hit, end: self.space().centre(key).map(|c| c as f32) });
        match self.occupancy(key) {
            Occupancy::Occupied => return start(true),
            Occupancy::Unknown if !through_unknown => return start(false),
            _ => {}
        }
        let length = norm(direction) as f32;
        let unit = direction.map(|axis| axis / length);
        if !unit.iter().all(|axis| axis.is_finite()) || unit == [0.0; 3] {
            return None;
        }
        let mut walk = Walk::new(self.space(), origin, key, unit, HalfVoxel::Double);
        // The brick where the walk is; most steps stay in it.
        let mut brick = walk.code >> BRICK_BITS;
        let mut place = self.bricks.find(brick);
        loop {
            let advanced = walk.advance();
            let end = self.space().centre(morton::decode(walk.code)).map(|c| c as f32);
            if !advanced || max_range.is_some_and(|range| distance_squared(origin, end) > range * range) {
                return Some(RayCast { hit: false, end });
            }
            if walk.code >> BRICK_BITS != brick {
                brick = walk.code >> BRICK_BITS;
                place = self.bricks.find(brick);
            }
            let voxel = (walk.code & ((1 << BRICK_BITS) - 1)) as usize;
            let value = place.and_then(|place| self.bricks.value(place, voxel));
            match value {
                Some(value) if self.sensor().is_occupied(value) => return Some(RayCast { hit: true, end }),
                None if !through_unknown => return Some(RayCast { hit: false, end }),
                _ => {}
            }
        }
    }
}

/// Squares in `f32`, their sum in `f64`, as OctoMap has it.
fn distance_squared(a: [f32; 3], b: [f32; 3]) -> f64 {
    (0..3).map(|axis| f64::from((b[axis] - a[axis]) * (b[axis] - a[axis]))).sum()
}

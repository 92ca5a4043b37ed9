//! Rays through the finished map.

use crate::directory::Near;
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
        // The centre of a voxel on the ray is at most this much farther than where the ray leaves it.
        let safe = max_range.map_or(f64::INFINITY, |range| range - 2.0 * self.space().resolution());
        let end = |code| self.space().centre(morton::decode(code)).map(|c| c as f32);
        let is_beyond =
            |code| max_range.is_some_and(|range| distance_squared(origin, end(code)) > range * range);
        let stopped = |hit, code| Some(RayCast { hit, end: end(code) });
        let mut near = Near::default();
        let mut advanced = walk.advance();
        loop {
            // Most steps stay in the brick, and most bricks need no look at their voxels.
            let brick = walk.code >> BRICK_BITS;
            let here = self.here(brick, &mut near);
            loop {
                if !advanced || walk.next_crossing() > safe && is_beyond(walk.code) {
                    return stopped(false, walk.code);
                }
                let occupancy = match here {
                    Here::Unknown => Occupancy::Unknown,
                    Here::Uniform(occupancy) => occupancy,
                    Here::Mixed(place) => {
                        let voxel = (walk.code & ((1 << BRICK_BITS) - 1)) as usize;
                        self.occupancy_of(self.bricks.value(place, voxel))
                    }
                };
                match occupancy {
                    Occupancy::Occupied => return stopped(true, walk.code),
                    Occupancy::Unknown if !through_unknown => return stopped(false, walk.code),
                    _ => {}
                }
                advanced = walk.advance();
                if walk.code >> BRICK_BITS != brick {
                    break;
                }
            }
        }
    }

    fn here(&self, brick: u64, near: &mut Near) -> Here {
        let Some(place) = self.bricks.find_near(brick, near) else { return Here::Unknown };
        match self.bricks.uniform(place) {
            Some(value) => Here::Uniform(self.occupancy_of(Some(value))),
            None => Here::Mixed(place),
        }
    }
}

/// What is in the brick where a ray is.
#[derive(Clone, Copy)]
enum Here {
    Unknown,
    Uniform(Occupancy),
    /// Each voxel must be looked at, in the brick at this place.
    Mixed(u32),
}

/// Squares in `f32`, their sum in `f64`, as OctoMap has it.
fn distance_squared(a: [f32; 3], b: [f32; 3]) -> f64 {
    (0..3).map(|axis| f64::from((b[axis] - a[axis]) * (b[axis] - a[axis]))).sum()
}

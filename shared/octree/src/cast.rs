//! Rays through the finished map.

use crate::directory::Near;
use crate::morton::{self, BRICK_BITS};
use crate::skip::{Extent, Skipper};
use crate::trace::{HalfVoxel, Walk, norm};
use crate::{Key, Occupancy, OctreeMap};

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
    ///
    /// Bricks and tiles in which nothing can stop the ray are crossed in one step each.
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
        let walk = Walk::new(self.space(), origin, key, unit, HalfVoxel::Double);
        let ray = Ray { map: self, origin, through_unknown, max_range };
        Some(ray.skip(Skipper::new(&walk, key, unit)).unwrap_or_else(|| ray.step(walk)))
    }
}

/// What a ray asks of the voxels on its way.
struct Ray<'a> {
    map: &'a OctreeMap,
    origin: [f32; 3],
    through_unknown: bool,
    max_range: Option<f64>,
}

impl Ray<'_> {
    /// From brick to brick; `None` where it is not certain that OctoMap's walk takes the same way.
    fn skip(&self, mut walk: Skipper) -> Option<RayCast> {
        // The centre of a voxel on the ray is at most this much farther than where the ray leaves it.
        let safe = self.max_range.map_or(f64::INFINITY, |range| range - 2.0 * self.map.space().resolution());
        let mut near = Near::default();
        let (mut brick, mut here) = (u64::MAX, Here::Unknown(Extent::Brick));
        // An origin on borders, as that of a map often is, meets several at once: the first steps are single ones.
        let mut single = 3;
        loop {
            // The voxel where the walk is does not stop the ray; does its brick?
            let now = morton::encode(walk.key.map(|axis| axis >> 3));
            if now != brick {
                (brick, here) = (now, self.here(now, &mut near));
            }
            let passed = match here {
                _ if single > 0 => {
                    single -= 1;
                    false
                }
                Here::Unknown(extent) if self.through_unknown => {
                    walk.leave(extent, safe) || walk.leave(Extent::Brick, safe)
                }
                Here::Uniform(Occupancy::Free) => walk.leave(Extent::Brick, safe),
                Here::Mixed { words: 0, .. } if self.through_unknown => walk.leave(Extent::Brick, safe),
                _ => false,
            };
            if !passed {
                walk.advance();
            }
            if !walk.certain {
                return None;
            }
            if walk.passed > safe && self.is_beyond(walk.key) {
                return Some(self.stopped(false, walk.key));
            }
            let now = morton::encode(walk.key.map(|axis| axis >> 3));
            if now != brick {
                (brick, here) = (now, self.here(now, &mut near));
            }
            if let Some(hit) = self.stop(here, || morton::within(walk.key)) {
                return Some(self.stopped(hit, walk.key));
            }
        }
    }

    /// Voxel by voxel, exactly.
    #[cold]
    fn step(&self, mut walk: Walk) -> RayCast {
        let mut near = Near::default();
        loop {
            let advanced = walk.advance();
            let key = morton::decode(walk.code);
            if !advanced || self.is_beyond(key) {
                return self.stopped(false, key);
            }
            let here = self.here(walk.code >> BRICK_BITS, &mut near);
            if let Some(hit) = self.stop(here, || (walk.code & ((1 << BRICK_BITS) - 1)) as usize) {
                return self.stopped(hit, key);
            }
        }
    }

    /// Whether a voxel stops the ray, and as a hit.
    #[inline]
    fn stop(&self, here: Here, voxel: impl Fn() -> usize) -> Option<bool> {
        let occupancy = match here {
            Here::Unknown(_) => Occupancy::Unknown,
            Here::Uniform(occupancy) => occupancy,
            Here::Mixed { place, words } => {
                let voxel = voxel();
                if self.through_unknown && words >> (voxel / 64) & 1 == 0 {
                    return None;
                }
                self.map.occupancy_of(self.map.bricks.value(place, voxel))
            }
        };
        match occupancy {
            Occupancy::Occupied => Some(true),
            Occupancy::Unknown if !self.through_unknown => Some(false),
            _ => None,
        }
    }

    #[inline]
    fn here(&self, brick: u64, near: &mut Near) -> Here {
        let bricks = &self.map.bricks;
        let Some(place) = bricks.find_near(brick, near) else {
            return Here::Unknown(if near.is_tile() { Extent::Brick } else { Extent::Tile });
        };
        match bricks.uniform(place) {
            Some(value) => Here::Uniform(self.map.occupancy_of(Some(value))),
            None => Here::Mixed { place, words: bricks.occupied_words(place) },
        }
    }

    /// Squares in `f32`, their sum in `f64`, as OctoMap has it.
    fn is_beyond(&self, key: Key) -> bool {
        let Some(range) = self.max_range else { return false };
        let centre = self.map.space().centre(key);
        let square = |axis: usize| {
            let difference = centre[axis] as f32 - self.origin[axis];
            f64::from(difference * difference)
        };
        square(0) + square(1) + square(2) > range * range
    }

    fn stopped(&self, hit: bool, key: Key) -> RayCast {
        RayCast { hit, end: self.map.space().centre(key).map(|c| c as f32) }
    }
}

/// What is in the brick where a ray is.
#[derive(Clone, Copy)]
enum Here {
    /// Nothing, as far as this.
    Unknown(Extent),
    Uniform(Occupancy),
    /// Each voxel must be looked at in the brick at this place, an occupied one may be in these words.
    Mixed {
        place: u32,
        words: u8,
    },
}

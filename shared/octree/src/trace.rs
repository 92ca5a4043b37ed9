//! Rays through the voxel grid: Amanatides and Woo's traversal with OctoMap's rounding.

use crate::morton::{self, AXES};
use crate::{Key, KeySpace};

/// A walk along a ray, voxel by voxel.
pub(crate) struct Walk {
    /// Code of the voxel where the walk is.
    pub(crate) code: u64,
    /// Path lengths, metres, at which the ray next crosses a border of each axis.
    crossing: [f64; 3],
    /// Path length between two borders of each axis, metres.
    spacing: [f64; 3],
    delta: [u64; 3],
    /// The axis' bits in the last voxel of the key space in the ray's direction.
    last: [u64; 3],
}

/// How the distance from the first voxel's centre to its border is rounded; OctoMap's two traversals differ.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum HalfVoxel {
    /// To `f32`, in `computeRayKeys`.
    Single,
    /// Not at all, in `castRay`.
    Double,
}

impl Walk {
    /// A walk from `origin` in the voxel `key` along a unit vector.
    #[inline]
    pub(crate) fn new(
        space: &KeySpace,
        origin: [f32; 3],
        key: Key,
        direction: [f32; 3],
        half: HalfVoxel,
    ) -> Self {
        let mut walk = Self {
            code: morton::encode(key),
            crossing: [f64::MAX; 3],
            spacing: [f64::MAX; 3],
            delta: [0; 3],
            last: [u64::MAX; 3],
        };
        for axis in 0..3 {
            let along = direction[axis];
            if along == 0.0 {
                continue;
            }
            let forward = along > 0.0;
            let sign = if forward { 1.0 } else { -1.0 };
            let to_border = sign * space.resolution() * 0.5;
            let to_border = if half == HalfVoxel::Single { f64::from(to_border as f32) } else { to_border };
            let border = space.axis_centre(key[axis]) + to_border;
            walk.crossing[axis] = (border - f64::from(origin[axis])) / f64::from(along);
            walk.spacing[axis] = space.resolution() / f64::from(along).abs();
            walk.delta[axis] = if forward { 1 << axis } else { AXES[axis] };
            walk.last[axis] = if forward { AXES[axis] } else { 0 };
        }
        walk
    }

    /// Goes to the next voxel; `false` at the edge of the key space.
    ///
    /// Which axis comes next is as good as random, so everything is selected rather than branched on: x where it is
    /// first, y where it is before z, z among equals, as OctoMap decides.
    #[inline]
    pub(crate) fn advance(&mut self) -> bool {
        let [x, y, z] = self.crossing;
        let along_x = (x < y) & (x < z);
        let along_y = (x >= y) & (y < z);
        let along_z = !along_x & !along_y;
        let select = |[x, y, z]: [u64; 3]| {
            if along_x {
                x
            } else if along_y {
                y
            } else {
                z
            }
        };
        let mask = select(AXES);
        if self.code & mask == select(self.last) {
            return false;
        }
        self.code = morton::step(self.code, mask, select(self.delta));
        let [dx, dy, dz] = self.spacing;
        self.crossing = [
            x + if along_x { dx } else { 0.0 },
            y + if along_y { dy } else { 0.0 },
            z + if along_z { dz } else { 0.0 },
        ];
        true
    }

    /// Path lengths to the next border of each axis, and between two borders, metres.
    pub(crate) fn borders(&self) -> ([f64; 3], [f64; 3]) {
        (self.crossing, self.spacing)
    }

    /// Path length to the next border, metres.
    #[inline]
    pub(crate) fn next_crossing(&self) -> f64 {
        let [x, y, z] = self.crossing;
        x.min(y).min(z)
    }
}

/// Calls `visit` with the codes of the voxels from `origin` up to, but without, the one that holds `end`, and gives that
/// one's code; `None` where either has no key. Ends at the latest at the edge of the key space.
#[inline]
pub(crate) fn trace(
    space: &KeySpace,
    origin: [f32; 3],
    end: [f32; 3],
    mut visit: impl FnMut(u64),
) -> Option<u64> {
    let first = space.key(origin)?;
    let last = space.key(end)?;
    let last_code = morton::encode(last);
    if first == last {
        return Some(last_code);
    }
    let (direction, length) = direction_and_length(origin, end);
    if !direction.iter().all(|axis| axis.is_finite()) {
        // So short that the length underflows, across a border: no voxel lies between.
        return Some(last_code);
    }
    let length = f64::from(length as f32);
    let mut walk = Walk::new(space, origin, first, direction, HalfVoxel::Single);
    visit(walk.code);
    // Rounding may carry the walk past the end's voxel; the length stops it then.
    while walk.advance() && walk.code != last_code && walk.next_crossing() <= length {
        visit(walk.code);
    }
    Some(last_code)
}

/// Unit vector from `origin` to `end` and their distance in metres, rounded as OctoMap rounds.
#[inline]
pub(crate) fn direction_and_length(origin: [f32; 3], end: [f32; 3]) -> ([f32; 3], f64) {
    let difference = [end[0] - origin[0], end[1] - origin[1], end[2] - origin[2]];
    let length = norm(difference);
    (difference.map(|axis| axis / length as f32), length)
}

/// Length of a vector: the squares summed in `f32`, the root taken in `f64`.
#[inline]
pub(crate) fn norm([x, y, z]: [f32; 3]) -> f64 {
    f64::from(x * x + y * y + z * z).sqrt()
}

//! A walk along a ray that crosses empty space in leaps and still is OctoMap's.
//!
//! OctoMap adds the spacing of borders again and again and compares the sums. Which voxels the walk passes depends on
//! those comparisons only. Here the sums are products, which differ from them by roundings; as long as every comparison
//! comes out by more than all roundings together can make, the way is the same, whatever was left out between. Where
//! one does not, `certain` becomes false, and the walk has to be done anew, step by step.

use crate::Key;
use crate::trace::Walk;

/// More than the roundings of 65,536 additions, and of the products in their place, in proportion to the sum.
const TOLERANCE: f64 = 1.0 / (1_u64 << 35) as f64;

/// An aligned cube.
#[derive(Clone, Copy)]
pub(crate) enum Extent {
    /// 8 x 8 x 8 voxels.
    Brick,
    /// 64 x 64 x 64 voxels.
    Tile,
}

impl Extent {
    fn edge(self) -> u16 {
        match self {
            Self::Brick => 8,
            Self::Tile => 64,
        }
    }
}

/// See the module.
pub(crate) struct Skipper {
    /// The voxel where the walk is.
    pub(crate) key: Key,
    /// Path length to the next border, metres.
    pub(crate) passed: f64,
    /// Whether OctoMap's walk has certainly come here, too.
    pub(crate) certain: bool,
    leapt: bool,
    /// By axis: path length to the next border.
    crossing: [f64; 3],
    /// By axis: path length between two borders, and its reciprocal.
    spacing: [f64; 3],
    per_spacing: [f64; 3],
    /// By axis: whether the walk goes up.
    forward: [bool; 3],
}

impl Skipper {
    /// The same start as a step by step walk from `key` along a unit vector.
    pub(crate) fn new(walk: &Walk, key: Key, unit: [f32; 3]) -> Self {
        let (crossing, spacing) = walk.borders();
        Self {
            key,
            passed: 0.0,
            certain: true,
            leapt: false,
            crossing,
            spacing,
            per_spacing: spacing.map(f64::recip),
            forward: unit.map(|axis| axis > 0.0),
        }
    }

    /// Goes to the next voxel.
    #[inline]
    pub(crate) fn advance(&mut self) {
        let [x, y, z] = self.crossing;
        let axis = if x < y {
            if x < z { 0 } else { 2 }
        } else if y < z {
            1
        } else {
            2
        };
        let (low, high) = (x.min(y), x.max(y));
        let (first, second) = (low.min(z), low.max(high.min(z)));
        // Up to the first leap the sums are OctoMap's to the last bit.
        self.certain &= !self.leapt || second - first > first * TOLERANCE;
        self.step(axis);
        self.crossing[axis] += self.spacing[axis];
        self.note();
    }

    /// Goes to the first voxel outside a cube of this extent; `false`, and goes nowhere, where a voxel on the way is left
    /// later than `safe`.
    #[inline]
    pub(crate) fn leave(&mut self, extent: Extent, safe: f64) -> bool {
        let edge = extent.edge();
        // By axis: steps that stay within, and the path length at which the one after them leaves.
        let within = [0, 1, 2].map(|axis| {
            let place = self.key[axis] & (edge - 1);
            f64::from(if self.forward[axis] { edge - 1 - place } else { place })
        });
        let leaving = [0, 1, 2].map(|axis| self.crossing[axis] + within[axis] * self.spacing[axis]);
        let [x, y, z] = leaving;
        let (low, high) = (x.min(y), x.max(y));
        let first = low.min(z);
        if first >= safe {
            return false;
        }
        self.leapt = true;
        let tolerance = first * TOLERANCE;
        self.certain &= low.max(high.min(z)) - first > tolerance;
        let out = if x == first { 0 } else { usize::from(y != first) + 1 };
        for (axis, within) in within.into_iter().enumerate() {
            if axis == out {
                self.walk(axis, within);
                self.crossing[axis] = first + self.spacing[axis];
                self.step(axis);
                continue;
            }
            let ahead = first - self.crossing[axis];
            if ahead < -tolerance {
                continue;
            }
            // Borders of this axis that are crossed before.
            let steps = f64::from((ahead * self.per_spacing[axis]) as u32) + 1.0;
            let next = self.crossing[axis] + steps * self.spacing[axis];
            self.certain &= ahead > tolerance
                && next - first > tolerance
                && first - (next - self.spacing[axis]) > tolerance
                && steps <= within;
            self.walk(axis, steps);
            self.crossing[axis] = next;
        }
        self.note();
        true
    }

    /// So many voxels along an axis, within the cube.
    #[inline]
    fn walk(&mut self, axis: usize, steps: f64) {
        let (key, steps) = (self.key[axis], steps as u16);
        self.key[axis] = if self.forward[axis] { key.wrapping_add(steps) } else { key.wrapping_sub(steps) };
    }

    /// One voxel along an axis.
    #[inline]
    fn step(&mut self, axis: usize) {
        let key = self.key[axis];
        let next = if self.forward[axis] { key.checked_add(1) } else { key.checked_sub(1) };
        // The edge of the key space is left to the exact walk.
        self.certain &= next.is_some();
        self.key[axis] = next.unwrap_or(key);
    }

    fn note(&mut self) {
        let [x, y, z] = self.crossing;
        self.passed = x.min(y).min(z);
    }
}

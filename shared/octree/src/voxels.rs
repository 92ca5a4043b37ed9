//! Walks over the whole map.

use evac_frames::{Voxel, voxel_flags};

use crate::bricks::Bricks;
use crate::mask::{Bits, Mask, has};
use crate::morton::{self, BRICK_BITS};
use crate::{Key, OctreeMap};

/// Every voxel with a value or a flag, in Morton order; see [`OctreeMap::voxels`].
#[derive(Debug)]
pub struct Voxels<'a> {
    bricks: &'a Bricks,
    /// The bricks that are left.
    sorted: std::vec::IntoIter<(u64, u32)>,
    brick: (u64, u32),
    ground: Mask,
    bits: Bits,
    left: usize,
}

impl OctreeMap {
    /// Every voxel with a log-odds value or a flag, in Morton order (that of an octree's leaves), whatever the order in
    /// which they came. Sorts the directory first, so this is for snapshots and files, not for every scan.
    pub fn voxels(&self) -> Voxels<'_> {
        Voxels {
            bricks: &self.bricks,
            sorted: self.bricks.sorted().into_iter(),
            brick: (0, 0),
            ground: Mask::default(),
            bits: Bits::default(),
            left: self.listed,
        }
    }

    /// How many voxels [`Self::voxels`] gives.
    pub fn voxel_count(&self) -> usize {
        self.listed
    }

    /// Lowest and highest key per axis of the voxels with a log-odds value, both inclusive; `None` for an empty map.
    pub fn bounds(&self) -> Option<(Key, Key)> {
        let mut bounds: Option<(Key, Key)> = None;
        for (code, place) in self.bricks.sorted() {
            let corner = morton::decode(code << BRICK_BITS);
            let inside = bounds.is_some_and(|(min, max)| {
                (0..3).all(|axis| min[axis] <= corner[axis] && max[axis] >= corner[axis] + 7)
            });
            if inside {
                continue;
            }
            for voxel in Bits::of(self.bricks.known(place)) {
                let key = morton::decode(code << BRICK_BITS | voxel as u64);
                let (min, max) = bounds.get_or_insert((key, key));
                for axis in 0..3 {
                    min[axis] = min[axis].min(key[axis]);
                    max[axis] = max[axis].max(key[axis]);
                }
            }
        }
        bounds
    }
}

impl Iterator for Voxels<'_> {
    type Item = Voxel;

    fn next(&mut self) -> Option<Voxel> {
        loop {
            let (code, place) = self.brick;
            if let Some(voxel) = self.bits.next() {
                self.left -= 1;
                return Some(frame(code, self.bricks.value(place, voxel), &self.ground, voxel));
            }
            self.brick = self.sorted.next()?;
            let known = self.bricks.known(self.brick.1);
            self.ground = self.bricks.ground(self.brick.1);
            self.bits = Bits::of(std::array::from_fn(|word| known[word] | self.ground[word]));
        }
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        (self.left, Some(self.left))
    }
}

impl ExactSizeIterator for Voxels<'_> {}

/// The state of a voxel as it is published.
#[inline]
pub(crate) fn frame(brick_code: u64, value: Option<f32>, ground: &Mask, voxel: usize) -> Voxel {
    let known = if value.is_some() { voxel_flags::KNOWN } else { 0 };
    let ground = if has(ground, voxel) { voxel_flags::GROUND } else { 0 };
    Voxel {
        key: morton::decode(brick_code << BRICK_BITS | voxel as u64),
        flags: known | ground,
        log_odds: value.unwrap_or(0.0),
    }
}

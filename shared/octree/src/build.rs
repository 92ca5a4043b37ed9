//! A map from the leaves of a tree, brick by brick.

use crate::directory::Near;
use crate::mask::{self, BRICK_VOXELS, Mask, WORDS};
use crate::morton::BRICK_BITS;
use crate::{MapError, OctreeMap};

/// Depth of a voxel.
const FINEST: u32 = 16;

/// Depth of a node that spans one brick.
const BRICK_DEPTH: u32 = FINEST - BRICK_BITS / 3;

/// Takes leaves in pre-order.
pub(crate) struct Builder {
    map: OctreeMap,
    near: Near,
    /// The brick that is being filled.
    brick: Option<u64>,
    groups: Groups,
}

/// The voxels of a brick by their values.
#[derive(Default)]
pub(crate) struct Groups {
    values: Vec<f32>,
    masks: Vec<Mask>,
    last: usize,
}

impl Groups {
    /// Gives one value to `length` (1, 8 or 64) voxels from `start` on.
    #[inline]
    fn add(&mut self, start: usize, length: usize, value: f32) {
        let is = |other: f32| other.to_bits() == value.to_bits();
        if self.values.get(self.last).is_none_or(|&last| !is(last)) {
            self.last = self.values.iter().position(|&other| is(other)).unwrap_or_else(|| {
                self.values.push(value);
                self.masks.push([0; WORDS]);
                self.values.len() - 1
            });
        }
        mask::set_range(&mut self.masks[self.last], start, length);
    }

    fn clear(&mut self) {
        self.values.clear();
        self.masks.clear();
        self.last = 0;
    }

    /// Values, each with its voxels; no two share one.
    pub(crate) fn iter(&self) -> impl ExactSizeIterator<Item = (f32, &Mask)> {
        self.values.iter().copied().zip(&self.masks)
    }
}

impl Builder {
    /// Fills an empty map.
    pub(crate) fn new(map: OctreeMap) -> Self {
        Self { map, near: Near::default(), brick: None, groups: Groups::default() }
    }

    /// Adds the leaf of a depth whose code has so many levels.
    #[inline]
    pub(crate) fn leaf(&mut self, code: u64, depth: u32, log_odds: f32) -> Result<(), MapError> {
        if depth <= BRICK_DEPTH {
            self.end_brick()?;
            return self.bricks(code, depth, log_odds);
        }
        let levels = 3 * (FINEST - depth);
        let first = code << levels;
        if self.brick != Some(first >> BRICK_BITS) {
            self.end_brick()?;
            self.brick = Some(first >> BRICK_BITS);
        }
        // Minus zero would be another value than zero in files, and equal to it in pruning.
        self.groups.add(first as usize % BRICK_VOXELS, 1 << levels, log_odds + 0.0);
        Ok(())
    }

    /// The map.
    pub(crate) fn finish(mut self) -> Result<OctreeMap, MapError> {
        self.end_brick()?;
        Ok(self.map)
    }

    fn too_large(&self) -> MapError {
        MapError::TooLarge { max_bytes: self.map.bricks.max_bytes() }
    }

    /// Sets all voxels of the node with this code and depth, of a brick or more.
    fn bricks(&mut self, code: u64, depth: u32, log_odds: f32) -> Result<(), MapError> {
        let levels = 3 * (BRICK_DEPTH - depth);
        let bricks = 1_u64 << levels;
        if !self.map.bricks.has_room_for_uniform(bricks) {
            return Err(self.too_large());
        }
        for brick in 0..bricks {
            let place = self.map.bricks.find_or_add_one((code << levels) + brick, &mut self.near);
            let Some(place) = place else { return Err(self.too_large()) };
            self.map.bricks.assign(place, &[u64::MAX; WORDS], log_odds + 0.0, self.map.revision);
        }
        self.map.known += BRICK_VOXELS * bricks as usize;
        self.map.listed += BRICK_VOXELS * bricks as usize;
        Ok(())
    }

    fn end_brick(&mut self) -> Result<(), MapError> {
        let Some(code) = self.brick.take() else { return Ok(()) };
        let Some(place) = self.map.bricks.find_or_add_one(code, &mut self.near) else {
            return Err(self.too_large());
        };
        self.map.bricks.fill(place, &self.groups, self.map.revision);
        let known: usize = self.groups.iter().map(|(_, voxels)| mask::count(voxels)).sum();
        self.map.known += known;
        self.map.listed += known;
        self.groups.clear();
        Ok(())
    }
}

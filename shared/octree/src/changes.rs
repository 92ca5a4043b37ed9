//! What the last scan changed.

use evac_frames::Voxel;

use crate::OctreeMap;
use crate::bricks::split_place;
use crate::mask::{Bits, Mask};
use crate::voxels::frame;

/// The voxels that the last scan changed, in Morton order; see [`OctreeMap::changes`].
#[derive(Debug)]
pub struct Changes<'a> {
    map: &'a OctreeMap,
    /// Number of the next brick of the scan.
    next: usize,
    /// Code and place.
    brick: (u64, u32),
    ground: Mask,
    bits: Bits,
    left: usize,
}

impl OctreeMap {
    /// How many voxels the last [`Self::insert_scan`] changed.
    pub fn changed(&self) -> usize {
        self.changed
    }

    /// The voxels to which the last [`Self::insert_scan`] gave a new value or a new flag, with their present state, in
    /// Morton order. A voxel that was at its clamp and stays there is not among them. Does not allocate. Nothing after
    /// bricks were taken out of the map.
    pub fn changes(&self) -> Changes<'_> {
        Changes {
            map: self,
            next: 0,
            brick: (0, 0),
            ground: Mask::default(),
            bits: Bits::default(),
            left: self.changed,
        }
    }
}

impl Iterator for Changes<'_> {
    type Item = Voxel;

    #[inline]
    fn next(&mut self) -> Option<Voxel> {
        loop {
            let (code, place) = self.brick;
            if let Some(voxel) = self.bits.next() {
                self.left -= 1;
                return Some(frame(code, self.map.bricks.value(place, voxel), &self.ground, voxel));
            }
            let marked = self.map.marked.get(self.next)?;
            self.next += 1;
            self.brick = (marked.brick, marked.place);
            self.ground = self.map.bricks.ground(marked.place);
            let (store, _) = split_place(marked.place);
            self.bits = Bits::of(self.map.work[store].changed[marked.number as usize]);
        }
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        (self.left, Some(self.left))
    }
}

impl ExactSizeIterator for Changes<'_> {}

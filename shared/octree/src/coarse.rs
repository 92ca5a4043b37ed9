//! Free space in blocks of 4 x 4 x 4 voxels: fast and not OctoMap's.

use crate::marks::ScanMarks;
use crate::mask::Bits;
use crate::morton::{self, BRICK_BITS};
use crate::rays::{Caster, Origin, Ray};
use crate::window::Window;
use crate::{Key, KeySpace};

/// Edge of a block in voxels: a word of a mask.
const EDGE: u16 = 4;

/// The block of coordinate zero, among keys of blocks and among keys of voxels divided by the edge.
const OFFSETS: [u16; 2] = [32_768, 32_768 / EDGE];

/// Casts rays in a grid of blocks.
#[derive(Debug)]
pub(crate) struct CoarseCaster {
    marks: ScanMarks,
    rays: Vec<Ray>,
}

impl CoarseCaster {
    pub(crate) fn new(max_bytes: usize) -> Self {
        Self { marks: ScanMarks::new(max_bytes), rays: Vec::new() }
    }

    /// Marks the blocks that rays pass, one ray to the centre of each block in which rays end; a block in which a hit was
    /// marked before is left alone. `false` where the blocks have no keys.
    pub(crate) fn cast(
        &mut self,
        space: &KeySpace,
        origin: [f32; 3],
        rays: &[Ray],
        caster: &mut Caster,
        marks: &mut ScanMarks,
    ) -> bool {
        let Some(space) = KeySpace::new(space.resolution() * f64::from(EDGE)) else { return false };
        let Some(key) = space.key(origin) else { return false };
        self.rays.clear();
        for ray in rays {
            if let Some(key) = space.key(ray.end) {
                self.rays.push(Ray { end: space.centre(key).map(|axis| axis as f32), key, ends: true });
            }
        }
        self.marks.start(Window::around(key, &self.rays, 2));
        let coarse = &mut self.marks;
        self.rays.retain(|ray| coarse.mark_hit(coarse.window().code(ray.key)));
        let from = Origin::new(&space, origin, key, coarse.window());
        caster.cast(&from, &self.rays, coarse);
        for (slot, code) in self.marks.bricks() {
            for block in Bits::of(*self.marks.free(slot)) {
                let block = morton::decode(code << BRICK_BITS | block as u64);
                if let Some(key) = voxel_of(block).filter(|key| marks.window().contains(*key)) {
                    marks.mark_block(key);
                }
            }
        }
        true
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        self.marks.memory_bytes() + self.rays.capacity() * size_of::<Ray>()
    }
}

/// The lowest voxel of a block; `None` beyond the key space.
fn voxel_of(block: Key) -> Option<Key> {
    let mut voxel = [0; 3];
    for axis in 0..3 {
        let number = block[axis].checked_add(OFFSETS[1])?.checked_sub(OFFSETS[0])?;
        voxel[axis] = number.checked_mul(EDGE)?;
    }
    Some(voxel)
}

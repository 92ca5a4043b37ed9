//! Which voxels one scan touches: bit masks per brick in place of sets of keys. Everything is kept for the next scan, so
//! that a scan like the ones before it allocates nothing.

use crate::bricks::{Mask, set};
use crate::morton::BRICK_BITS;

const VOXEL: u64 = (1 << BRICK_BITS) - 1;
const NONE: u32 = u32::MAX;

/// What one scan says about a brick.
#[derive(Clone, Debug, Default)]
pub(crate) struct Marks {
    /// Code of the brick.
    pub(crate) brick: u64,
    /// Passed by a ray, or the end of a ground ray.
    pub(crate) free: Mask,
    /// The end of a ray.
    pub(crate) hit: Mask,
    /// The end of a ground ray.
    pub(crate) ground: Mask,
    /// After the update: voxels with a new state.
    pub(crate) changed: Mask,
    /// After the update: where the brick is in the store.
    pub(crate) place: u32,
    /// Where the table points here.
    entry: u32,
}

/// The marks of one scan.
#[derive(Debug)]
pub(crate) struct ScanMarks {
    /// Open addressing: an index into `marks` or [`NONE`]; a power of two long, at most half full.
    table: Vec<u32>,
    marks: Vec<Marks>,
    used: usize,
    /// The used marks by ascending brick.
    order: Vec<u32>,
    max: usize,
    /// Brick of the last mark and its index, or [`NONE`] where it was refused: the next mark is mostly in it, too.
    last_brick: u64,
    last_index: u32,
    /// Times that a brick was refused because the scan touches more than `max`.
    pub(crate) refused: u32,
}

impl ScanMarks {
    /// Marks for at most `max` bricks.
    pub(crate) fn new(max: u32) -> Self {
        Self {
            table: vec![NONE; 1024],
            marks: Vec::new(),
            used: 0,
            order: Vec::new(),
            max: max as usize,
            last_brick: u64::MAX,
            last_index: NONE,
            refused: 0,
        }
    }

    /// Forgets the last scan.
    pub(crate) fn clear(&mut self) {
        for marks in &self.marks[..self.used] {
            self.table[marks.entry as usize] = NONE;
        }
        self.used = 0;
        self.order.clear();
        self.last_brick = u64::MAX;
        self.last_index = NONE;
        self.refused = 0;
    }

    /// A ray passes through the voxel.
    #[inline]
    pub(crate) fn mark_free(&mut self, code: u64) {
        if let Some(marks) = self.at(code) {
            set(&mut marks.free, (code & VOXEL) as usize);
        }
    }

    /// A ray ends in the voxel.
    #[inline]
    pub(crate) fn mark_hit(&mut self, code: u64) {
        if let Some(marks) = self.at(code) {
            set(&mut marks.hit, (code & VOXEL) as usize);
        }
    }

    /// A ground ray ends in the voxel.
    #[inline]
    pub(crate) fn mark_ground(&mut self, code: u64) {
        if let Some(marks) = self.at(code) {
            set(&mut marks.free, (code & VOXEL) as usize);
            set(&mut marks.ground, (code & VOXEL) as usize);
        }
    }

    /// Whether a ray of this scan has ended in the voxel.
    pub(crate) fn is_hit(&mut self, code: u64) -> bool {
        self.at(code).is_some_and(|marks| crate::bricks::has(&marks.hit, (code & VOXEL) as usize))
    }

    /// Whether a ground ray of this scan has ended in the voxel.
    pub(crate) fn is_ground(&mut self, code: u64) -> bool {
        self.at(code).is_some_and(|marks| crate::bricks::has(&marks.ground, (code & VOXEL) as usize))
    }

    /// Puts the bricks in Morton order, so that what follows does not depend on the order of the points.
    pub(crate) fn sort(&mut self) {
        self.order.clear();
        self.order.extend(0..self.used as u32);
        let marks = &self.marks;
        self.order.sort_unstable_by_key(|&index| marks[index as usize].brick);
    }

    /// Number of bricks in [`Self::sorted`].
    pub(crate) fn len(&self) -> usize {
        self.order.len()
    }

    /// The `n`-th brick in Morton order.
    pub(crate) fn sorted(&self, n: usize) -> Option<&Marks> {
        self.order.get(n).map(|&index| &self.marks[index as usize])
    }

    /// The same, to be written.
    pub(crate) fn sorted_mut(&mut self, n: usize) -> Option<&mut Marks> {
        self.order.get(n).map(|&index| &mut self.marks[index as usize])
    }

    #[inline]
    fn at(&mut self, code: u64) -> Option<&mut Marks> {
        let brick = code >> BRICK_BITS;
        if brick != self.last_brick {
            self.last_index = self.find_or_add(brick);
            self.last_brick = brick;
        }
        self.marks.get_mut(self.last_index as usize)
    }

    fn find_or_add(&mut self, brick: u64) -> u32 {
        let mut entry = home(brick, self.table.len());
        loop {
            match self.table[entry] {
                NONE => break,
                index if self.marks[index as usize].brick == brick => return index,
                _ => entry = (entry + 1) & (self.table.len() - 1),
            }
        }
        if self.used >= self.max {
            self.refused = self.refused.saturating_add(1);
            return NONE;
        }
        let index = self.used as u32;
        let fresh = Marks { brick, place: NONE, entry: entry as u32, ..Marks::default() };
        match self.marks.get_mut(self.used) {
            Some(marks) => *marks = fresh,
            None => self.marks.push(fresh),
        }
        self.table[entry] = index;
        self.used += 1;
        if self.used * 2 > self.table.len() {
            self.grow();
        }
        index
    }

    fn grow(&mut self) {
        let length = self.table.len() * 2;
        self.table.clear();
        self.table.resize(length, NONE);
        for (index, marks) in self.marks[..self.used].iter_mut().enumerate() {
            let mut entry = home(marks.brick, length);
            while self.table[entry] != NONE {
                entry = (entry + 1) & (length - 1);
            }
            self.table[entry] = index as u32;
            marks.entry = entry as u32;
        }
    }
}

/// First entry to look at: the high bits of a Fibonacci hash.
#[inline]
fn home(brick: u64, length: usize) -> usize {
    let hash = brick.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (hash >> (64 - length.trailing_zeros())) as usize
}

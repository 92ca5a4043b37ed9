//! Taking parts of the map out.

use crate::mask::{self, Mask, WORDS};
use crate::morton::{self, BRICK_BITS};
use crate::{Key, OctreeMap};

impl OctreeMap {
    /// Makes all voxels in the box of keys from `min` to `max`, both inclusive, unknown and takes their flags; gives how
    /// many had a log-odds value. The memory is used again.
    pub fn delete_box(&mut self, min: Key, max: Key) -> usize {
        if (0..3).any(|axis| min[axis] > max[axis]) {
            return 0;
        }
        let mut bricks = Vec::new();
        self.bricks.for_each_in(min, max, |code, place| bricks.push((code, place)));
        bricks
            .into_iter()
            .map(|(code, place)| {
                self.erase(code, place, &mask::inside(morton::decode(code << BRICK_BITS), min, max))
            })
            .sum()
    }

    /// Makes all voxels outside the box of keys from `min` to `max`, both inclusive, unknown; see [`Self::delete_box`].
    pub fn keep_box(&mut self, min: Key, max: Key) -> usize {
        let empty = (0..3).any(|axis| min[axis] > max[axis]);
        let outside = |code: u64| {
            let inside = mask::inside(morton::decode(code << BRICK_BITS), min, max);
            if empty { [u64::MAX; WORDS] } else { inside.map(|word| !word) }
        };
        let bricks = self.bricks.sorted();
        bricks.into_iter().map(|(code, place)| self.erase(code, place, &outside(code))).sum()
    }

    /// Forgets voxels of a brick, and the brick where nothing is left; gives how many had a value.
    pub(crate) fn erase(&mut self, code: u64, place: u32, voxels: &Mask) -> usize {
        let (known, ground) = (self.bricks.known(place), self.bricks.ground(place));
        let (mut values, mut listed, mut left) = (0, 0, 0);
        for word in 0..WORDS {
            let any = known[word] | ground[word];
            values += (known[word] & voxels[word]).count_ones() as usize;
            listed += (any & voxels[word]).count_ones() as usize;
            left |= any & !voxels[word];
        }
        if listed == 0 && left != 0 {
            return 0;
        }
        self.known -= values;
        self.listed -= listed;
        self.revision = self.revision.wrapping_add(1);
        self.removal = self.revision;
        // The changes of the last scan point into bricks that may be gone.
        self.marked.clear();
        self.changed = 0;
        if left == 0 {
            self.bricks.remove(code);
        } else {
            self.bricks.erase(place, voxels, self.revision);
        }
        values
    }
}

//! The leaves of the octree that the map stands for, without building it.

use crate::bricks::Bricks;
use crate::decoded::Decoded;
use crate::morton::{self, BRICK_BITS};
use crate::{Key, OctreeMap};

/// Depth of the finest nodes.
const FINEST: u32 = 16;

/// Depth of a node that spans one brick.
const BRICK: u32 = 13;

/// A leaf of the pruned octree, or an inner node where the depth is limited.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leaf {
    /// Key of its voxel with the lowest coordinates.
    pub key: Key,
    /// 16 for a voxel; each step up doubles the edge. 0 spans the whole key space.
    pub depth: u8,
    /// Log-odds; of an inner node the greatest of its leaves', as OctoMap has it.
    pub log_odds: f32,
}

impl Leaf {
    /// Edge in voxels.
    pub fn edge(&self) -> u32 {
        1 << (FINEST - u32::from(self.depth))
    }

    fn new(code: u64, depth: u32, log_odds: f32) -> Self {
        Self { key: morton::decode(code), depth: depth as u8, log_odds }
    }
}

impl OctreeMap {
    /// Calls `visit` with every leaf of the pruned octree in the order of OctoMap's leaf iterator. Nodes at `depth` (1 to
    /// 16, the finest) count as leaves, with the greatest log-odds below them.
    pub fn for_each_leaf(&self, depth: u8, mut visit: impl FnMut(Leaf)) {
        let depth = u32::from(depth).clamp(1, FINEST);
        let sorted = self.bricks.sorted();
        let mut decoded = Decoded::default();
        let mut at = 0;
        while let Some(&(code, place)) = sorted.get(at) {
            let (merged, up, value) = self.merged(&sorted[at..]);
            if up > 0 || value.is_some() && depth >= BRICK {
                // A leaf of one or more whole bricks, perhaps above the depth asked for.
                if BRICK - up <= depth || depth >= BRICK {
                    visit(Leaf::new(code << BRICK_BITS, BRICK - up, value.unwrap_or(0.0)));
                    at += merged;
                    continue;
                }
            }
            if depth >= BRICK {
                self.bricks.decode(place, &mut decoded);
                brick_leaves(code, &decoded, depth, &mut visit);
                at += 1;
                continue;
            }
            let node = code >> (3 * (BRICK - depth));
            let below = sorted[at..].iter().take_while(|(code, _)| code >> (3 * (BRICK - depth)) == node);
            let mut count = 0;
            let mut greatest = f32::NEG_INFINITY;
            for &(_, place) in below {
                count += 1;
                greatest = greatest.max(self.bricks.greatest(place));
            }
            if greatest > f32::NEG_INFINITY {
                visit(Leaf::new(node << (3 * (FINEST - depth)), depth, greatest));
            }
            at += count;
        }
    }

    /// Calls `visit` with the leaves that overlap the box of keys from `min` to `max`, both inclusive, in no particular
    /// order. A leaf of more than one brick (8 voxels) is told brick by brick.
    pub fn for_each_leaf_in(&self, min: Key, max: Key, mut visit: impl FnMut(Leaf)) {
        if (0..3).any(|axis| min[axis] > max[axis]) {
            return;
        }
        self.bricks.for_each_in(min, max, |code, place| {
            let corner = morton::decode(code << BRICK_BITS);
            let (store, index) = self.bricks.at(place);
            if let Some(log_odds) = store.uniform(index, self.bricks.palette()) {
                visit(Leaf { key: corner, depth: BRICK as u8, log_odds });
                return;
            }
            let inside = crate::mask::inside(corner, min, max);
            store.for_each_leaf_within(index, self.bricks.palette(), &inside, |voxel, depth, log_odds| {
                let [x, y, z] = WITHIN[voxel];
                visit(Leaf { key: [corner[0] | x, corner[1] | y, corner[2] | z], depth, log_odds });
            });
        });
    }

    /// How many of these bricks are one leaf, how many levels above a brick it is, and its value.
    fn merged(&self, bricks: &[(u64, u32)]) -> (usize, u32, Option<f32>) {
        let Some(&(code, place)) = bricks.first() else { return (0, 0, None) };
        let Some(value) = self.bricks.uniform(place) else { return (1, 0, None) };
        let (mut count, mut up) = (1_usize, 0);
        // The root is never a leaf.
        while up < BRICK - 1 && code & (7 << (3 * up)) == 0 && bricks.len() >= count * 8 {
            let next = count * 8;
            let same = (count..next)
                .all(|n| bricks[n].0 == code + n as u64 && self.bricks.uniform(bricks[n].1) == Some(value));
            if !same {
                break;
            }
            (count, up) = (next, up + 1);
        }
        (count, up, Some(value))
    }
}

/// The leaves of one brick down to a depth of 13 to 16.
#[inline]
fn brick_leaves(code: u64, brick: &Decoded, depth: u32, visit: &mut impl FnMut(Leaf)) {
    let first = code << BRICK_BITS;
    if depth == BRICK {
        let known = (0..8).filter(|&word| brick.known[word] != 0);
        let greatest = known.fold(f32::NEG_INFINITY, |max, word| max.max(brick.greatest_of_word(word)));
        if greatest > f32::NEG_INFINITY {
            visit(Leaf::new(first, BRICK, greatest));
        }
        return;
    }
    let corner = morton::decode(first);
    let key = |voxel: usize| -> Key {
        let [x, y, z] = WITHIN[voxel];
        [corner[0] | x, corner[1] | y, corner[2] | z]
    };
    for word in 0..8 {
        let known = brick.known[word];
        if known == 0 {
            continue;
        }
        if brick.words >> word & 1 != 0 || depth == 14 {
            let log_odds = brick.greatest_of_word(word);
            visit(Leaf { key: key(word * 64), depth: 14, log_odds });
            continue;
        }
        for block in 0..8 {
            let present = known >> (8 * block) & 0xff;
            if present == 0 {
                continue;
            }
            let at = word * 64 + block * 8;
            if depth == 15 || brick.blocks[word] >> (8 * block) & 1 != 0 {
                let log_odds = brick.greatest_of_block(word, block);
                visit(Leaf { key: key(at), depth: 15, log_odds });
                continue;
            }
            let mut left = present;
            while left != 0 {
                let voxel = at + left.trailing_zeros() as usize;
                left &= left - 1;
                visit(Leaf { key: key(voxel), depth: 16, log_odds: brick.values[voxel] });
            }
        }
    }
}

/// Coordinates of a brick's voxels within it.
static WITHIN: [Key; 512] = {
    let mut keys = [[0; 3]; 512];
    let mut voxel = 0;
    while voxel < 512 {
        let mut axis = 0;
        while axis < 3 {
            let bits = voxel >> axis;
            keys[voxel][axis] = ((bits & 1) | (bits >> 3 & 1) << 1 | (bits >> 6 & 1) << 2) as u16;
            axis += 1;
        }
        voxel += 1;
    }
    keys
};

impl Bricks {
    /// The voxels of a brick.
    pub(crate) fn decode(&self, place: u32, decoded: &mut Decoded) {
        let (store, index) = self.at(place);
        store.decode(index, self.palette(), decoded);
    }

    /// Greatest log-odds in a brick; minus infinity where nothing is known.
    pub(crate) fn greatest(&self, place: u32) -> f32 {
        let (store, index) = self.at(place);
        let mut greatest = f32::NEG_INFINITY;
        store.for_each_value(index, self.palette(), |_, _, value| greatest = greatest.max(value));
        greatest
    }

    /// The value that all voxels of a brick have.
    #[inline]
    pub(crate) fn uniform(&self, place: u32) -> Option<f32> {
        let (store, index) = self.at(place);
        store.uniform(index, self.palette())
    }
}

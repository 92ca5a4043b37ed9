//! How many nodes the pruned octree has.

use crate::OctreeMap;
use crate::bricks::Bricks;

/// Levels above a brick.
const ABOVE: u32 = 13;

impl OctreeMap {
    /// How many nodes, inner ones and leaves, the octree of this map has when it is pruned: what OctoMap's `prune()` finds
    /// and its `size()` then says, without an octree.
    pub fn node_count(&self) -> usize {
        let sorted = self.bricks.sorted_known();
        if sorted.is_empty() { 0 } else { count(&self.bricks, &sorted, ABOVE).0 }
    }
}

/// Nodes of the tree over these bricks, whose root is so many levels above a brick, the root included, and its value
/// where it is a leaf.
fn count(bricks: &Bricks, below: &[(u64, u32)], level: u32) -> (usize, Option<f32>) {
    if level == 0 {
        return count_in_brick(bricks, below[0].1);
    }
    let shift = 3 * (level - 1);
    let (mut nodes, mut children, mut equal, mut leaf) = (1, 0, true, None);
    let mut rest = below;
    while let Some(&(code, _)) = rest.first() {
        let child = code >> shift;
        let end = if shift == 0 { 1 } else { rest.partition_point(|&(code, _)| code >> shift == child) };
        let (more, value) = count(bricks, &rest[..end], level - 1);
        equal &= value.is_some() && (children == 0 || value == leaf);
        (nodes, children, leaf) = (nodes + more, children + 1, value);
        rest = &rest[end..];
    }
    // The root is never pruned.
    if equal && children == 8 && level < ABOVE { (1, leaf) } else { (nodes, None) }
}

fn count_in_brick(bricks: &Bricks, place: u32) -> (usize, Option<f32>) {
    if let Some(value) = bricks.uniform(place) {
        return (1, Some(value));
    }
    let (store, index) = bricks.at(place);
    let shape = store.shape(index, bricks.palette());
    let mut nodes = 1;
    for word in (0..8).filter(|word| shape.known[*word] != 0) {
        nodes += 1;
        if shape.words >> word & 1 == 0 {
            let single = shape.known[word] & !shape.blocks[word].wrapping_mul(0xff);
            nodes += crate::decoded::any_bit(shape.known[word]).count_ones() as usize;
            nodes += single.count_ones() as usize;
        }
    }
    (nodes, None)
}

//! The map as an octree with inner nodes, and back.

use evac_formats::octomap::{DEPTH, Node, OcTreeFile};

use crate::bricks::Bricks;
use crate::build::Builder;
use crate::decoded::Decoded;
use crate::morton::BRICK_BITS;
use crate::{MapConfig, MapError, OctreeMap, SensorModel};

/// Depth of a node that spans one brick.
const BRICK_DEPTH: u32 = DEPTH as u32 - BRICK_BITS / 3;

/// Whether eight equal leaves become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pruning {
    /// At every level, as OctoMap's insertion leaves the tree.
    Full,
    /// Not at all, as after OctoMap's lazy insertion.
    None,
}

impl OctreeMap {
    /// The octree that OctoMap would have after the same insertions. Ground flags have no place in it.
    pub fn to_tree(&self, pruning: Pruning) -> OcTreeFile {
        let sorted = self.bricks.sorted_known();
        let mut writer = Writer {
            bricks: &self.bricks,
            prune: pruning == Pruning::Full,
            nodes: Vec::new(),
            decoded: Decoded::default(),
        };
        if !sorted.is_empty() {
            writer.upper(&sorted, 0);
        }
        OcTreeFile::assume_valid(self.space().resolution(), writer.nodes)
    }

    /// The bytes of a `.ot` file, as OctoMap's `write` makes them after the same insertions.
    pub fn ot_bytes(&self) -> Vec<u8> {
        evac_formats::octomap::ot_bytes(&self.to_tree(Pruning::Full))
    }

    /// A map with the leaves of a tree; a leaf above the finest level fills all its voxels.
    ///
    /// # Errors
    /// [`MapError::TooLarge`] before more than `max_bytes` are taken, and as [`OctreeMap::new`].
    pub fn from_tree(tree: &OcTreeFile, sensor: SensorModel, max_bytes: usize) -> Result<Self, MapError> {
        let map = Self::new(MapConfig { sensor, max_bytes, ..MapConfig::new(tree.resolution()) })?;
        let mut builder = Builder::new(map);
        // Children that are still to come, and the code, of each open ancestor.
        let mut open: Vec<(u8, u64)> = Vec::with_capacity(DEPTH);
        for node in tree.nodes() {
            let code = match open.last_mut() {
                Some((left, parent)) => {
                    let child = left.trailing_zeros();
                    *left &= left.wrapping_sub(1);
                    *parent << 3 | u64::from(child)
                }
                None => 0,
            };
            if node.child_mask != 0 {
                open.push((node.child_mask, code));
                continue;
            }
            builder.leaf(code, open.len() as u32, node.log_odds)?;
            while open.last().is_some_and(|&(left, _)| left == 0) {
                open.pop();
            }
        }
        builder.finish()
    }
}

/// Writes the nodes in pre-order: a parent's place is kept free until its children are known.
struct Writer<'a> {
    bricks: &'a Bricks,
    prune: bool,
    nodes: Vec<Node>,
    decoded: Decoded,
}

impl Writer<'_> {
    /// The node of `depth` above these bricks, which are sorted and not none.
    fn upper(&mut self, bricks: &[(u64, u32)], depth: u32) {
        if depth == BRICK_DEPTH {
            for &(_, place) in bricks {
                self.brick(place);
            }
            return;
        }
        let shift = 3 * (BRICK_DEPTH - depth - 1);
        self.parent(|writer, child| {
            let from = bricks.partition_point(|&(code, _)| code >> shift & 7 < child);
            let to = bricks.partition_point(|&(code, _)| code >> shift & 7 <= child);
            let children = bricks.get(from..to).unwrap_or_default();
            if !children.is_empty() {
                writer.upper(children, depth + 1);
            }
        });
    }

    /// The node of a brick, of which at least one voxel is known.
    fn brick(&mut self, place: u32) {
        if let (true, Some(log_odds)) = (self.prune, self.bricks.uniform(place)) {
            self.nodes.push(Node { log_odds, child_mask: 0 });
            return;
        }
        let mut brick = std::mem::take(&mut self.decoded);
        self.bricks.decode(place, &mut brick);
        let at = self.nodes.len();
        self.nodes.push(Node { log_odds: 0.0, child_mask: 0 });
        let (mut greatest, mut child_mask) = (f32::NEG_INFINITY, 0);
        for word in (0..8).filter(|&word| brick.known[word] != 0) {
            child_mask |= 1 << word;
            greatest = greatest.max(self.word(&brick, word));
        }
        self.nodes[at] = Node { log_odds: greatest, child_mask };
        self.decoded = brick;
    }

    /// The node of 4 x 4 x 4 voxels; gives its value.
    fn word(&mut self, brick: &Decoded, word: usize) -> f32 {
        if self.prune && brick.words >> word & 1 != 0 {
            let log_odds = brick.values[word * 64];
            self.nodes.push(Node { log_odds, child_mask: 0 });
            return log_odds;
        }
        let at = self.nodes.len();
        self.nodes.push(Node { log_odds: 0.0, child_mask: 0 });
        let (mut greatest, mut child_mask) = (f32::NEG_INFINITY, 0);
        for block in 0..8 {
            let present = (brick.known[word] >> (8 * block)) as u8;
            if present == 0 {
                continue;
            }
            child_mask |= 1 << block;
            let first = word * 64 + block * 8;
            if brick.blocks[word] >> (8 * block) & 1 != 0 {
                let log_odds = brick.values[first];
                greatest = greatest.max(log_odds);
                if self.prune {
                    self.nodes.push(Node { log_odds, child_mask: 0 });
                } else {
                    self.nodes.push(Node { log_odds, child_mask: 0xff });
                    self.nodes.extend([Node { log_odds, child_mask: 0 }; 8]);
                }
                continue;
            }
            let parent = self.nodes.len();
            self.nodes.push(Node { log_odds: 0.0, child_mask: present });
            let mut max = f32::NEG_INFINITY;
            let mut left = present;
            while left != 0 {
                let log_odds = brick.values[first + left.trailing_zeros() as usize];
                left &= left - 1;
                max = max.max(log_odds);
                self.nodes.push(Node { log_odds, child_mask: 0 });
            }
            self.nodes[parent].log_odds = max;
            greatest = greatest.max(max);
        }
        self.nodes[at] = Node { log_odds: greatest, child_mask };
        greatest
    }

    /// A node with the children that `write` appends for 0 to 7; pruned where they are eight equal leaves.
    fn parent(&mut self, mut write: impl FnMut(&mut Self, u64)) {
        let at = self.nodes.len();
        self.nodes.push(Node { log_odds: f32::NEG_INFINITY, child_mask: 0 });
        let (mut greatest, mut child_mask, mut leaves) = (f32::NEG_INFINITY, 0u8, 0);
        let mut first = None;
        for child in 0..8 {
            let before = self.nodes.len();
            write(self, child);
            let Some(node) = self.nodes.get(before) else { continue };
            child_mask |= 1 << child;
            greatest = greatest.max(node.log_odds);
            let value = *first.get_or_insert(node.log_odds);
            leaves += u32::from(node.child_mask == 0 && node.log_odds == value);
        }
        match first {
            Some(log_odds) if leaves == 8 && self.prune => {
                self.nodes.truncate(at);
                self.nodes.push(Node { log_odds, child_mask: 0 });
            }
            _ => self.nodes[at] = Node { log_odds: greatest, child_mask },
        }
    }
}

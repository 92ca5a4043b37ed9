//! The map as an octree with inner nodes, and back.

use evac_formats::octomap::{DEPTH, Node, OcTreeFile};

use crate::bricks::Bricks;
use crate::directory::Near;
use crate::mask::{self, BRICK_VOXELS};
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
        let mut sorted = self.bricks.sorted();
        sorted.retain(|&(_, place)| !mask::is_empty(&self.bricks.known(place)));
        let mut writer = Writer { bricks: &self.bricks, prune: pruning == Pruning::Full, nodes: Vec::new() };
        if !sorted.is_empty() {
            writer.upper(&sorted, 0);
        }
        OcTreeFile::assume_valid(self.space().resolution(), writer.nodes)
    }

    /// A map with the leaves of a tree; a leaf above the finest level fills all its voxels.
    ///
    /// # Errors
    /// [`MapError::TooLarge`] before more than `max_bricks` bricks are taken, and as [`OctreeMap::new`].
    pub fn from_tree(tree: &OcTreeFile, sensor: SensorModel, max_bricks: u32) -> Result<Self, MapError> {
        let mut map = Self::new(MapConfig { sensor, max_bricks, ..MapConfig::new(tree.resolution()) })?;
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
            map.fill(code, open.len() as u32, node.log_odds)?;
            while open.last().is_some_and(|&(left, _)| left == 0) {
                open.pop();
            }
        }
        Ok(map)
    }

    /// Sets all voxels of the node with this code and depth.
    fn fill(&mut self, code: u64, depth: u32, log_odds: f32) -> Result<(), MapError> {
        let too_large = MapError::TooLarge { max_bricks: self.bricks.max() };
        let levels = 3 * (DEPTH as u32 - depth);
        let first = code << levels;
        let voxels = (1usize << levels.min(BRICK_BITS)).min(BRICK_VOXELS);
        let bricks = 1u64 << levels.saturating_sub(BRICK_BITS);
        if bricks > u64::from(self.bricks.max() - self.bricks.len()) && depth < BRICK_DEPTH {
            return Err(too_large);
        }
        let start = (first & (BRICK_VOXELS as u64 - 1)) as usize;
        let mask = mask::range(start, voxels);
        let mut near = Near::default();
        for brick in 0..bricks {
            let code = (first >> BRICK_BITS) + brick;
            let place = self.bricks.find_or_add(code, &mut near).ok_or(too_large.clone())?;
            self.bricks.assign(place, &mask, log_odds, self.revision);
        }
        self.known += voxels * bricks as usize;
        self.listed += voxels * bricks as usize;
        Ok(())
    }
}

/// Writes the nodes in pre-order: a parent's place is kept free until its children are known.
struct Writer<'a> {
    bricks: &'a Bricks,
    prune: bool,
    nodes: Vec<Node>,
}

impl Writer<'_> {
    /// The node of `depth` above these bricks, which are sorted and not none.
    fn upper(&mut self, bricks: &[(u64, u32)], depth: u32) {
        if depth == BRICK_DEPTH {
            for &(_, place) in bricks {
                self.lower(place, 0, BRICK_VOXELS);
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

    /// The node above `length` voxels of a brick, of which at least one is known.
    fn lower(&mut self, place: u32, start: usize, length: usize) {
        if length == 1 {
            let log_odds = self.bricks.value(place, start).unwrap_or(0.0);
            self.nodes.push(Node { log_odds, child_mask: 0 });
            return;
        }
        self.parent(|writer, child| {
            let part = length / 8;
            let from = start + child as usize * part;
            let known = writer.bricks.known(place);
            let any = match part {
                64 => known[from / 64] != 0,
                _ => known[from / 64] >> (from % 64) & ((1 << part) - 1) != 0,
            };
            if any {
                writer.lower(place, from, part);
            }
        });
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

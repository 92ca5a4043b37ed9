//! `.bt` straight from the bricks.

use evac_formats::octomap::{DEPTH, bt_header};

use crate::OctreeMap;
use crate::bricks::Bricks;
use crate::decoded::LOWEST;
use crate::morton::BRICK_BITS;

/// Depth of a node that spans one brick.
const BRICK_DEPTH: u32 = DEPTH as u32 - BRICK_BITS / 3;

/// Codes of a child, two bits each.
const FREE: u16 = 1;
const OCCUPIED: u16 = 2;
const INNER: u16 = 3;

impl OctreeMap {
    /// The bytes of a `.bt` file as OctoMap's `writeBinary` makes them: every voxel surely free or surely occupied, pruned.
    /// Ground flags have no place in it.
    ///
    /// OctoMap's `prune` goes from depth 15 up to 1 and stops at the first depth at which there is nothing to merge, so a
    /// tree may keep eight equal leaves higher up; files are byte-equal only with the same halt.
    pub fn bt_bytes(&self) -> Vec<u8> {
        let (body, nodes) = self.binary_body();
        let mut bytes = bt_header(nodes, self.space().resolution());
        bytes.extend_from_slice(&body);
        bytes
    }

    /// Bytes behind the text, and the number of nodes.
    pub(crate) fn binary_body(&self) -> (Vec<u8>, usize) {
        let sorted = self.bricks.sorted_known();
        // At first as if pruning went up to the root. Where it halts before, what was merged above is written anew.
        let mut writer = Writer::new(&self.bricks, 1);
        writer.root(&sorted);
        let halt = (1..DEPTH as u32).rev().find(|&depth| !writer.merged[depth as usize]).unwrap_or(0);
        if (1..halt).any(|depth| writer.merged[depth as usize]) {
            writer = Writer::new(&self.bricks, halt + 1);
            writer.root(&sorted);
        }
        (writer.bytes, writer.nodes)
    }
}

/// Writes nodes in pre-order.
struct Writer<'a> {
    bricks: &'a Bricks,
    /// Least depth at which equal leaves are merged, besides those that are equal in the map.
    merge_from: u32,
    /// By depth: whether leaves were merged there.
    merged: [bool; DEPTH],
    bytes: Vec<u8>,
    nodes: usize,
}

/// A child as its parent sees it.
#[derive(Clone, Copy)]
struct Child {
    code: u16,
    /// Its value, if it is a leaf of the map's tree already.
    leaf: Option<f32>,
}

impl<'a> Writer<'a> {
    fn new(bricks: &'a Bricks, merge_from: u32) -> Self {
        Self { bricks, merge_from, merged: [false; DEPTH], bytes: Vec::new(), nodes: 0 }
    }

    fn root(&mut self, bricks: &[(u64, u32)]) {
        if !bricks.is_empty() {
            self.nodes = 1;
            self.upper(bricks, 0);
        }
    }

    /// The node of `depth` above these bricks, which are sorted and not none.
    fn upper(&mut self, bricks: &[(u64, u32)], depth: u32) -> Child {
        if depth == BRICK_DEPTH {
            return self.brick(bricks[0].1);
        }
        let shift = 3 * (BRICK_DEPTH - depth - 1);
        let (at, nodes) = (self.bytes.len(), self.nodes);
        self.bytes.extend([0, 0]);
        let (mut word, mut rest) = (0, bricks);
        let mut leaf = None;
        let mut equal = true;
        while let Some(&(code, _)) = rest.first() {
            let child = code >> shift;
            let end = if shift == 0 { 1 } else { rest.partition_point(|&(code, _)| code >> shift == child) };
            let found = self.upper(&rest[..end], depth + 1);
            equal &= found.leaf.is_some() && (word == 0 || found.leaf == leaf);
            leaf = found.leaf;
            word |= found.code << (2 * (child & 7));
            rest = &rest[end..];
        }
        let all = word == FREE * 0x5555 || word == OCCUPIED * 0x5555;
        let leaf = leaf.filter(|_| all && equal && depth > 0);
        if all && depth > 0 && (leaf.is_some() || self.merges(depth)) {
            self.bytes.truncate(at);
            self.nodes = nodes;
            return Child { code: word & 3, leaf };
        }
        self.bytes[at..at + 2].copy_from_slice(&word.to_le_bytes());
        self.count(word);
        Child { code: INNER, leaf: None }
    }

    /// Notes that leaves could be merged at a depth; says whether they are.
    fn merges(&mut self, depth: u32) -> bool {
        self.merged[depth as usize] = true;
        depth >= self.merge_from
    }

    /// The nodes below one.
    fn count(&mut self, word: u16) {
        self.nodes += ((word | word >> 1) & 0x5555).count_ones() as usize;
    }

    /// The node of a brick.
    fn brick(&mut self, place: u32) -> Child {
        let (store, index) = self.bricks.at(place);
        let palette = self.bricks.palette();
        if let Some(value) = store.uniform(index, palette) {
            return Child { code: if palette.occupies(value) { OCCUPIED } else { FREE }, leaf: Some(value) };
        }
        let (shape, occupied) = (store.shape(index, palette), store.occupied(index, palette));
        let (at, nodes) = (self.bytes.len(), self.nodes);
        self.bytes.extend([0, 0]);
        let mut word16 = 0;
        for word in (0..8).filter(|word| shape.known[*word] != 0) {
            let is_leaf = shape.words >> word & 1 != 0;
            let code = self.word(shape.known[word], occupied[word], shape.blocks[word], is_leaf);
            word16 |= code << (2 * word);
        }
        if (word16 == FREE * 0x5555 || word16 == OCCUPIED * 0x5555) && self.merges(BRICK_DEPTH) {
            self.bytes.truncate(at);
            self.nodes = nodes;
            return Child { code: word16 & 3, leaf: None };
        }
        self.bytes[at..at + 2].copy_from_slice(&word16.to_le_bytes());
        self.count(word16);
        Child { code: INNER, leaf: None }
    }

    /// The node of 4 x 4 x 4 voxels, of which at least one is known; gives its code.
    fn word(&mut self, known: u64, occupied: u64, equal: u64, is_leaf: bool) -> u16 {
        let free = known & !occupied;
        if is_leaf {
            return if free != 0 { FREE } else { OCCUPIED };
        }
        let (all_free, all_occupied) = (all_of_byte(free), all_of_byte(occupied));
        let mut leaves = all_free | all_occupied;
        if leaves & !equal != 0 && !self.merges(15) {
            leaves = equal;
        }
        let some = any_of_byte(known);
        if (all_free == LOWEST || all_occupied == LOWEST) && leaves == LOWEST && self.merges(14) {
            return if all_free == LOWEST { FREE } else { OCCUPIED };
        }
        let inner = some & !leaves;
        // Bit 0 of a code: free or inner; bit 1: occupied or inner.
        let low = spread(gather(all_free & leaves | inner));
        let word = low | spread(gather(all_occupied & leaves | inner)) << 1;
        self.bytes.extend(word.to_le_bytes());
        self.count(word);
        let mut left = inner;
        while left != 0 {
            let shift = left.trailing_zeros();
            left &= left - 1;
            let word = spread((free >> shift) as u8) | spread((occupied >> shift) as u8) << 1;
            self.bytes.extend(word.to_le_bytes());
            self.count(word);
        }
        INNER
    }
}

/// Bit 0 of each byte whose bits are all set.
fn all_of_byte(word: u64) -> u64 {
    LOWEST & !crate::decoded::any_bit(!word)
}

/// Bit 0 of each byte in which a bit is set.
fn any_of_byte(word: u64) -> u64 {
    crate::decoded::any_bit(word)
}

/// Bit 0 of each byte, side by side.
fn gather(word: u64) -> u8 {
    (word.wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8
}

/// A zero above each bit.
fn spread(bits: u8) -> u16 {
    let bits = u16::from(bits);
    let bits = (bits | bits << 4) & 0x0f0f;
    let bits = (bits | bits << 2) & 0x3333;
    (bits | bits << 1) & 0x5555
}

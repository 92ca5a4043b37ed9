//! The leaves of a file one by one, without a tree in memory.

use std::ops::ControlFlow;
use std::path::Path;

use super::binary::{FREE, INNER, OCCUPIED};
use super::header::{Header, Kind};
use super::tree::DEPTH;
use super::{BinaryValues, Fault};
use crate::FormatError;

const DAMAGED: &str = "the file is damaged: write it again from its source";

/// A leaf as it stands in a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FileLeaf {
    /// The children to take from the root, three bits each, the last lowest: the Morton code of its lowest voxel without
    /// the levels below it.
    pub code: u64,
    /// 16 for a voxel; each step up doubles the edge.
    pub depth: u8,
    /// Log-odds.
    pub log_odds: f32,
}

/// Reads the bytes of a `.ot` or `.bt` file leaf by leaf, in pre-order. Checks what [`super::read_bytes`] checks.
///
/// ```
/// use std::ops::ControlFlow;
/// use std::path::Path;
/// use evac_formats::octomap::{BinaryValues, Node, OcTreeFile, Reader, ot_bytes};
///
/// let leaf = Node { log_odds: 0.85, child_mask: 0 };
/// let bytes = ot_bytes(&OcTreeFile::new(0.1, vec![Node { log_odds: 0.85, child_mask: 1 << 7 }, leaf])?);
/// let mut leaves = Vec::new();
/// Reader::new(&bytes, Path::new("map.ot"))?.for_each_leaf(&BinaryValues::default(), |leaf| {
///     leaves.push((leaf.code, leaf.depth));
///     ControlFlow::Continue(())
/// })?;
/// assert_eq!(leaves, [(7, 1)]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    name: &'a Path,
    header: Header,
}

impl<'a> Reader<'a> {
    /// Reads the header; `name` is only for messages.
    ///
    /// # Errors
    /// [`FormatError::Malformed`] naming the byte and the remedy.
    pub fn new(bytes: &'a [u8], name: &'a Path) -> Result<Self, FormatError> {
        let header = Header::read(bytes).map_err(|fault| fault.in_file(name))?;
        Ok(Self { bytes, name, header })
    }

    /// Edge of a voxel, metres.
    pub fn resolution(&self) -> f64 {
        self.header.resolution
    }

    /// Calls `visit` with every leaf until it breaks. The leaves of a `.bt` get the two of `values`.
    ///
    /// # Errors
    /// [`FormatError::Malformed`] naming the byte and the remedy; the leaves before it have been visited.
    pub fn for_each_leaf(
        &self,
        values: &BinaryValues,
        visit: impl FnMut(FileLeaf) -> ControlFlow<()>,
    ) -> Result<(), FormatError> {
        let read = match self.header.kind {
            _ if self.header.size == 0 => Ok(()),
            Kind::Full => self.full(visit),
            Kind::Binary => self.binary(values, visit),
        };
        read.map_err(|fault| fault.in_file(self.name))
    }

    fn full(&self, mut visit: impl FnMut(FileLeaf) -> ControlFlow<()>) -> Result<(), Fault> {
        let body = self.bytes.get(self.header.body..).unwrap_or_default();
        let (chunks, rest) = body.as_chunks::<5>();
        // Children that are still to come, and the code, of each open ancestor.
        let mut open = [(0_u8, 0_u64); DEPTH];
        let (mut depth, mut code) = (0, 0);
        for (index, &[a, b, c, d, child_mask]) in chunks.iter().enumerate() {
            let offset = || self.header.body + index * 5;
            let log_odds = f32::from_le_bytes([a, b, c, d]);
            if !log_odds.is_finite() {
                return Err(Fault::new(offset(), format!("node {index} has log-odds {log_odds}"), DAMAGED));
            }
            if child_mask != 0 {
                let Some(slot) = open.get_mut(depth) else {
                    let cause = format!("node {index} has children below depth {DEPTH}");
                    let remedy = "the file is damaged, or its id is not OcTree: write it again";
                    return Err(Fault::new(offset() + 4, cause, remedy));
                };
                *slot = (child_mask, code);
                depth += 1;
            } else if visit(FileLeaf { code, depth: depth as u8, log_odds }).is_break() {
                return Ok(());
            }
            // The next node is the next child of the deepest ancestor that expects one.
            while depth > 0 && open[depth - 1].0 == 0 {
                depth -= 1;
            }
            let Some((left, parent)) = depth.checked_sub(1).and_then(|above| open.get_mut(above)) else {
                return self.complete(index as u64 + 1);
            };
            code = *parent << 3 | u64::from(left.trailing_zeros());
            *left &= *left - 1;
        }
        Err(Fault::truncated(self.bytes.len() - rest.len(), "the tree"))
    }

    fn binary(
        &self,
        values: &BinaryValues,
        mut visit: impl FnMut(FileLeaf) -> ControlFlow<()>,
    ) -> Result<(), Fault> {
        let mut at = self.header.body;
        let mut word = || {
            let pair = self.bytes.get(at..).and_then(|rest| rest.first_chunk::<2>());
            at += 2;
            pair.map(|&pair| (u16::from_le_bytes(pair), at - 2))
                .ok_or_else(|| Fault::truncated(at - 2, "the tree"))
        };
        // The codes of the children that are still to come, shifted so far that the next child's are lowest, the next
        // child, and the code, of each open ancestor.
        let mut open = [(0_u16, 0_u32, 0_u64); DEPTH];
        open[0].0 = word()?.0;
        let (mut depth, mut nodes) = (1, 1_u64);
        while depth > 0 {
            let (left, next, parent) = &mut open[depth - 1];
            if *left == 0 {
                depth -= 1;
                continue;
            }
            let skip = left.trailing_zeros() / 2;
            let (kind, child) = (*left >> (2 * skip) & 3, *next + skip);
            *left = left.checked_shr(2 * skip + 2).unwrap_or(0);
            *next = child + 1;
            let code = *parent << 3 | u64::from(child);
            nodes += 1;
            if kind == INNER {
                let (word, offset) = word()?;
                let index = nodes - 1;
                if word == 0 {
                    let cause = format!("node {index} has children according to its parent, but none");
                    return Err(Fault::new(offset, cause, DAMAGED));
                }
                let Some(slot) = open.get_mut(depth) else {
                    let cause = format!("node {index} has children below depth {DEPTH}");
                    return Err(Fault::new(offset, cause, DAMAGED));
                };
                *slot = (word, 0, code);
                depth += 1;
                continue;
            }
            debug_assert!(kind == FREE || kind == OCCUPIED);
            let log_odds = if kind == FREE { values.free } else { values.occupied };
            if visit(FileLeaf { code, depth: depth as u8, log_odds }).is_break() {
                return Ok(());
            }
        }
        self.complete(nodes)
    }

    fn complete(&self, nodes: u64) -> Result<(), Fault> {
        if nodes == self.header.size {
            return Ok(());
        }
        let cause = format!("the header says {} nodes, the tree has {nodes}", self.header.size);
        Err(Fault::new(self.header.body, cause, DAMAGED))
    }
}

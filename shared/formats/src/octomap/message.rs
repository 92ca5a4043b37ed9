//! The body of a file without its text, as `octomap_msgs/Octomap` carries it in `data`.

use std::path::Path;

use super::header::{Header, Kind};
use super::likelihood::BinaryValues;
use super::tree::{OcTreeFile, is_resolution};
use super::{Fault, binary, bt_bytes, bt_const_bytes, full, ot_bytes};
use crate::FormatError;

/// What `octomap_msgs/Octomap` says besides its header and its id, which is `OcTree`.
#[derive(Debug, Clone, PartialEq)]
pub struct OctomapBody {
    /// Two bits a child as in a `.bt` (`octomap_binary`), else log-odds as in a `.ot` (`octomap_full`).
    pub binary: bool,
    /// Edge of a voxel, metres.
    pub resolution: f64,
    /// Nodes in pre-order; nothing of an empty tree.
    pub data: Vec<u8>,
}

impl OctomapBody {
    /// The tree's log-odds, as `fullMapToMsg` makes them.
    pub fn full(tree: &OcTreeFile) -> Self {
        Self::behind_text(&ot_bytes(tree), false, tree.resolution())
    }

    /// Every voxel surely free or surely occupied, pruned, as `binaryMapToMsg` makes them of a map that it may change.
    pub fn binary(tree: &OcTreeFile, values: &BinaryValues) -> Self {
        Self::behind_text(&bt_bytes(tree, values), true, tree.resolution())
    }

    /// The tree as it stands, a leaf occupied from `threshold` (log-odds) on, as `binaryMapToMsg` makes them of a constant
    /// map.
    pub fn binary_as_it_stands(tree: &OcTreeFile, threshold: f32) -> Self {
        Self::behind_text(&bt_const_bytes(tree, threshold), true, tree.resolution())
    }

    /// The body of a `.ot` or `.bt` file; `name` is only for messages.
    ///
    /// # Errors
    /// [`FormatError::Malformed`] where the text in front of the tree is not OctoMap's. The tree itself is not read.
    pub fn of_file(bytes: &[u8], name: &Path) -> Result<Self, FormatError> {
        let Header { kind, resolution, body, .. } =
            Header::read(bytes).map_err(|fault: Fault| fault.in_file(name))?;
        let data = bytes.get(body..).unwrap_or_default().to_vec();
        Ok(Self { binary: kind == Kind::Binary, resolution, data })
    }

    /// Reads the tree; voxels of a binary body get `values`. `name` is only for messages. Memory stays in proportion to the
    /// data.
    ///
    /// # Errors
    /// [`FormatError::Malformed`] naming the byte of the data and the remedy.
    pub fn tree(&self, name: &Path, values: &BinaryValues) -> Result<OcTreeFile, FormatError> {
        let read = || {
            if !is_resolution(self.resolution) {
                let cause = format!("the resolution is {} m", self.resolution);
                return Err(Fault::new(0, cause, "the message is damaged, or not an octree's"));
            }
            let nodes = match (self.data.is_empty(), self.binary) {
                (true, _) => Vec::new(),
                (_, true) => binary::decode(&self.data, 0, u64::from(u32::MAX), values)?,
                (_, false) => full::decode(&self.data, 0, u64::from(u32::MAX))?,
            };
            Ok(OcTreeFile::assume_valid(self.resolution, nodes))
        };
        read().map_err(|fault: Fault| fault.in_file(name))
    }

    fn behind_text(file: &[u8], binary: bool, resolution: f64) -> Self {
        let body = Header::read(file).map_or(file.len(), |header| header.body);
        Self { binary, resolution, data: file.get(body..).unwrap_or_default().to_vec() }
    }
}

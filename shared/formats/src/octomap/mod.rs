//! OctoMap's files: `.ot` (full log-odds) and `.bt` (two bits a node), byte-equal to what the C++ library writes.
//!
//! Both hold one octree of 16 levels in pre-order, children by index `x | y << 1 | z << 2`; see [`OcTreeFile`].

mod binary;
mod full;
mod header;
mod likelihood;
mod message;
mod reader;
mod tree;

use std::fs;
use std::path::Path;

pub use likelihood::BinaryValues;
pub use message::OctomapBody;
pub use reader::{FileLeaf, Reader};
pub use tree::{DEPTH, Node, OcTreeFile, TreeError};

use crate::{FormatError, write_atomically};
use header::{Header, Kind};

/// Reads a `.ot` or `.bt` file, told apart by its first line, not by its name. The voxels of a `.bt` get OctoMap's
/// default values ([`BinaryValues::default`]); another model's are given to [`read_bytes`].
///
/// # Errors
/// [`FormatError`] naming the file, the byte and the remedy.
pub fn read(path: &Path) -> Result<OcTreeFile, FormatError> {
    let bytes = fs::read(path).map_err(|cause| FormatError::reading(path, cause))?;
    read_bytes(&bytes, path, &BinaryValues::default())
}

/// Reads the bytes of a `.ot` or `.bt` file; `name` is only for messages, `values` only for a `.bt`.
///
/// Like OctoMap it takes the header's fields in any order, skips unknown ones, reads the `.bt` of old versions (no
/// text header) and ignores bytes behind the tree. Memory stays in proportion to `bytes`, whatever the header claims.
///
/// # Errors
/// [`FormatError::Malformed`] naming the byte and the remedy.
pub fn read_bytes(bytes: &[u8], name: &Path, values: &BinaryValues) -> Result<OcTreeFile, FormatError> {
    read_file(bytes, values).map_err(|fault| fault.in_file(name))
}

fn read_file(bytes: &[u8], values: &BinaryValues) -> Result<OcTreeFile, Fault> {
    let Header { kind, size, resolution, body } = Header::read(bytes)?;
    let nodes = match kind {
        _ if size == 0 => Vec::new(),
        Kind::Full => full::decode(bytes, body, size)?,
        Kind::Binary => binary::decode(bytes, body, size, values)?,
    };
    if nodes.len() as u64 != size {
        let cause = format!("the header says {size} nodes, the tree has {}", nodes.len());
        return Err(Fault::new(body, cause, "the file is damaged: write it again from its source"));
    }
    Ok(OcTreeFile::assume_valid(resolution, nodes))
}

/// The text in front of a `.ot`'s tree of so many nodes, with voxels of `resolution` metres.
pub fn ot_header(nodes: usize, resolution: f64) -> Vec<u8> {
    Header::text(Kind::Full, nodes, resolution)
}

/// The text in front of a `.bt`'s tree.
pub fn bt_header(nodes: usize, resolution: f64) -> Vec<u8> {
    Header::text(Kind::Binary, nodes, resolution)
}

/// The bytes of a `.ot` file.
pub fn ot_bytes(tree: &OcTreeFile) -> Vec<u8> {
    let mut bytes = ot_header(tree.nodes().len(), tree.resolution());
    full::encode(tree.nodes(), &mut bytes);
    bytes
}

/// The bytes of a `.bt` file as OctoMap's `writeBinary` makes them: maximum likelihood, pruned.
pub fn bt_bytes(tree: &OcTreeFile, values: &BinaryValues) -> Vec<u8> {
    bt_const_bytes(&tree.max_likelihood_pruned(values), values.threshold)
}

/// The bytes of a `.bt` file as OctoMap's `writeBinaryConst` makes them: the tree as it stands, occupied from
/// `threshold` (log-odds) on.
pub fn bt_const_bytes(tree: &OcTreeFile, threshold: f32) -> Vec<u8> {
    let mut bytes = bt_header(tree.nodes().len(), tree.resolution());
    binary::encode(tree.nodes(), threshold, &mut bytes);
    bytes
}

/// Writes a `.ot` file, whole or not at all.
///
/// # Errors
/// [`FormatError::Io`].
pub fn write_ot(path: &Path, tree: &OcTreeFile) -> Result<(), FormatError> {
    write_bytes(path, &ot_bytes(tree))
}

/// Writes a `.bt` file with [`bt_bytes`], whole or not at all.
///
/// # Errors
/// [`FormatError::Io`].
pub fn write_bt(path: &Path, tree: &OcTreeFile, values: &BinaryValues) -> Result<(), FormatError> {
    write_bytes(path, &bt_bytes(tree, values))
}

fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), FormatError> {
    write_atomically(path, |writer| std::io::Write::write_all(writer, bytes))
}

/// What is wrong with the bytes, before it is known which file they are from.
#[derive(Debug)]
struct Fault {
    offset: usize,
    cause: String,
    remedy: &'static str,
}

impl Fault {
    fn new(offset: usize, cause: impl Into<String>, remedy: &'static str) -> Self {
        Self { offset, cause: cause.into(), remedy }
    }

    fn truncated(offset: usize, what: &str) -> Self {
        Self::new(
            offset,
            format!("the file ends inside {what}"),
            "the file is cut off: copy or write it again",
        )
    }

    fn in_file(self, name: &Path) -> FormatError {
        FormatError::malformed(name, self.offset as u64, self.cause, self.remedy)
    }
}

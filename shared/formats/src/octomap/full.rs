//! The body of a `.ot`: every node as little-endian `f32` log-odds and its child mask.

use super::Fault;
use super::tree::{DEPTH, Node, Shape, TooDeep};

/// Bytes of one node.
const NODE_BYTES: usize = 5;

/// Appends the nodes as they stand in the file.
pub(super) fn encode(nodes: &[Node], bytes: &mut Vec<u8>) {
    bytes.reserve(nodes.len() * NODE_BYTES);
    for node in nodes {
        bytes.extend_from_slice(&node.log_odds.to_le_bytes());
        bytes.push(node.child_mask);
    }
}

/// Reads one tree from `start` on. `size` is what the header promises and no more than a hint.
pub(super) fn decode(bytes: &[u8], start: usize, size: u64) -> Result<Vec<Node>, Fault> {
    let body = bytes.get(start..).unwrap_or_default();
    let (chunks, rest) = body.as_chunks::<NODE_BYTES>();
    let mut nodes = Vec::with_capacity(chunks.len().min(usize::try_from(size).unwrap_or(usize::MAX)));
    let mut shape = Shape::default();
    for (index, &[a, b, c, d, child_mask]) in chunks.iter().enumerate() {
        let offset = start + index * NODE_BYTES;
        let log_odds = f32::from_le_bytes([a, b, c, d]);
        if !log_odds.is_finite() {
            let cause = format!("node {index} has log-odds {log_odds}");
            return Err(Fault::new(offset, cause, "the file is damaged: write it again from its source"));
        }
        shape.push(child_mask).map_err(|TooDeep| {
            let cause = format!("node {index} has children below depth {DEPTH}");
            Fault::new(offset + 4, cause, "the file is damaged, or its id is not OcTree: write it again")
        })?;
        nodes.push(Node { log_odds, child_mask });
        if shape.complete() {
            return Ok(nodes);
        }
    }
    Err(Fault::truncated(bytes.len() - rest.len(), "the tree"))
}

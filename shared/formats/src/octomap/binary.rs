//! The body of a `.bt`: two bits for each child of each inner node, nothing for leaves.

use super::Fault;
use super::likelihood::BinaryValues;
use super::tree::{DEPTH, Node};

/// Codes of a child, two bits each, child 0 in the lowest.
pub(super) const FREE: u16 = 1;
pub(super) const OCCUPIED: u16 = 2;
pub(super) const INNER: u16 = 3;

/// Appends the tree as it stands; a leaf is occupied from `threshold` on. A tree that is only a root cannot be told
/// from an empty inner node; OctoMap writes a zero word for it, and so does this.
pub(super) fn encode(nodes: &[Node], threshold: f32, bytes: &mut Vec<u8>) {
    // For each inner node its word, filled while its children pass by; the words are in pre-order already.
    let mut open: [(usize, u8); DEPTH] = [(0, 0); DEPTH];
    let mut depth = 0;
    for (index, node) in nodes.iter().enumerate() {
        if depth > 0 {
            let (at, left) = open[depth - 1];
            let child = left.trailing_zeros();
            let code = match node.child_mask {
                0 if node.log_odds >= threshold => OCCUPIED,
                0 => FREE,
                _ => INNER,
            };
            let [low, high] = (code << (2 * child)).to_le_bytes();
            bytes[at] |= low;
            bytes[at + 1] |= high;
            open[depth - 1].1 = left & (left - 1);
        }
        if node.child_mask != 0 || index == 0 {
            open[depth] = (bytes.len(), node.child_mask);
            bytes.extend_from_slice(&[0, 0]);
            depth += 1;
        }
        while depth > 0 && open[depth - 1].1 == 0 {
            depth -= 1;
        }
    }
}

/// An inner node whose children are being read.
#[derive(Clone, Copy, Default)]
struct Open {
    node: usize,
    word: u16,
    next_child: u32,
    greatest: f32,
}

/// Reads one tree from `start` on. Stops early once there are more nodes than `size`, so that the caller reports it.
///
/// As OctoMap's `readBinaryNode`: leaves take the model's two values, inner nodes the greatest of their children's, the
/// root the occupied value whatever its children are.
pub(super) fn decode(
    bytes: &[u8],
    start: usize,
    size: u64,
    values: &BinaryValues,
) -> Result<Vec<Node>, Fault> {
    let mut at = start;
    let mut word = || {
        let pair = bytes.get(at..).and_then(|rest| rest.first_chunk::<2>());
        let word = pair.map(|&pair| u16::from_le_bytes(pair)).ok_or_else(|| Fault::truncated(at, "the tree"));
        at += 2;
        word.map(|word| (word, at - 2))
    };
    let mut nodes = Vec::new();
    let mut open = [Open::default(); DEPTH];
    let (root, _) = word()?;
    nodes.push(Node { log_odds: values.occupied, child_mask: mask(root) });
    open[0] = Open { node: 0, word: root, next_child: 0, greatest: f32::NEG_INFINITY };
    let mut depth = 1;
    while depth > 0 && nodes.len() as u64 <= size {
        let parent = &mut open[depth - 1];
        if parent.next_child == 8 {
            let Open { node, greatest, .. } = *parent;
            depth -= 1;
            if depth > 0 {
                nodes[node].log_odds = greatest;
                open[depth - 1].greatest = open[depth - 1].greatest.max(greatest);
            }
            continue;
        }
        let code = parent.word >> (2 * parent.next_child) & 3;
        parent.next_child += 1;
        match code {
            FREE | OCCUPIED => {
                let log_odds = if code == FREE { values.free } else { values.occupied };
                parent.greatest = parent.greatest.max(log_odds);
                nodes.push(Node { log_odds, child_mask: 0 });
            }
            INNER => {
                let (word, offset) = word()?;
                let damaged = "the file is damaged: write it again from its source";
                if word == 0 {
                    let cause =
                        format!("node {} has children according to its parent, but none", nodes.len());
                    return Err(Fault::new(offset, cause, damaged));
                }
                let Some(slot) = open.get_mut(depth) else {
                    let cause = format!("node {} has children below depth {DEPTH}", nodes.len());
                    return Err(Fault::new(offset, cause, damaged));
                };
                *slot = Open { node: nodes.len(), word, next_child: 0, greatest: f32::NEG_INFINITY };
                depth += 1;
                nodes.push(Node { log_odds: values.occupied, child_mask: mask(word) });
            }
            _ => {}
        }
    }
    Ok(nodes)
}

/// Which children a word names.
pub(super) fn mask(word: u16) -> u8 {
    (0..8).fold(0, |mask, child| mask | u8::from(word >> (2 * child) & 3 != 0) << child)
}

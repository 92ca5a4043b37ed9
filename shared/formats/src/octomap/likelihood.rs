//! What OctoMap does to a tree before `writeBinary`: each node becomes surely free or surely occupied, then it prunes.

use super::tree::{DEPTH, Node, OcTreeFile};

/// The two values that a `.bt` can tell apart, as log-odds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BinaryValues {
    /// Of a free node: the lower clamp of the sensor model.
    pub free: f32,
    /// Of an occupied node: the upper clamp of the sensor model.
    pub occupied: f32,
    /// A node is occupied from here on.
    pub threshold: f32,
}

impl Default for BinaryValues {
    /// OctoMap's clamps at probabilities 0.1192 and 0.971 and its threshold of 0.5.
    fn default() -> Self {
        Self { free: -2.000_028, occupied: 3.511_030_7, threshold: 0.0 }
    }
}

impl OcTreeFile {
    /// OctoMap's `toMaxLikelihood()` followed by `prune()`.
    ///
    /// `prune()` goes from depth 15 up to 1 and stops at the first depth at which nothing could be merged, so a tree
    /// may keep eight equal leaves higher up; files are byte-equal only with the same halt.
    #[must_use]
    pub fn max_likelihood_pruned(&self, values: &BinaryValues) -> Self {
        let mut nodes: Vec<Node> = self.nodes().to_vec();
        for node in &mut nodes {
            node.log_odds = if node.log_odds >= values.threshold { values.occupied } else { values.free };
        }
        let ends = self.subtree_ends();
        let by_depth = nodes_by_depth(&nodes);
        for inner in by_depth.iter().skip(1).rev() {
            let mut merged = false;
            for &index in inner {
                merged |= merge_children(&mut nodes, &ends, index as usize);
            }
            if !merged {
                break;
            }
        }
        // A merged node has lost its mask but its old subtree still stands behind it.
        let mut kept = Vec::with_capacity(nodes.len());
        let mut index = 0;
        while let Some(&node) = nodes.get(index) {
            kept.push(node);
            index = if node.child_mask == 0 { ends[index] as usize } else { index + 1 };
        }
        Self::assume_valid(self.resolution(), kept)
    }
}

/// Indices of the inner nodes of depths 0 to 15.
fn nodes_by_depth(nodes: &[Node]) -> [Vec<u32>; DEPTH] {
    let mut by_depth: [Vec<u32>; DEPTH] = Default::default();
    let mut left = [0u32; DEPTH];
    let mut depth = 0;
    for (index, node) in nodes.iter().enumerate() {
        if node.child_mask != 0 {
            by_depth[depth].push(index as u32);
            left[depth] = node.child_mask.count_ones();
            depth += 1;
            continue;
        }
        while depth > 0 {
            left[depth - 1] -= 1;
            if left[depth - 1] > 0 {
                break;
            }
            depth -= 1;
        }
    }
    by_depth
}

/// Makes a leaf of a node with eight equal leaves.
fn merge_children(nodes: &mut [Node], ends: &[u32], index: usize) -> bool {
    if nodes[index].child_mask != 0xff {
        return false;
    }
    let value = nodes[index + 1].log_odds;
    let mut child = index + 1;
    for _ in 0..8 {
        if nodes[child].child_mask != 0 || nodes[child].log_odds != value {
            return false;
        }
        child = ends[child] as usize;
    }
    nodes[index] = Node { log_odds: value, child_mask: 0 };
    true
}

//! The octree of a file, independent of how the file writes it down.

/// Levels below the root; a voxel of the finest level has depth 16.
pub const DEPTH: usize = 16;

/// One node of an octree in pre-order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Log-odds of occupancy; of an inner node the greatest of its children's.
    pub log_odds: f32,
    /// Bit `i` says that child `i = x | y << 1 | z << 2` exists; zero in a leaf.
    pub child_mask: u8,
}

/// Why nodes are not an octree.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum TreeError {
    /// The edge of a voxel is not a length.
    #[error("the resolution is {0} m; give the edge of a voxel in metres, greater than zero")]
    Resolution(f64),
    /// A node's value is no number.
    #[error("node {node} has log-odds {log_odds}; give a finite number")]
    LogOdds {
        /// Its place in pre-order.
        node: usize,
        /// Its value.
        log_odds: f32,
    },
    /// A node of the finest level has children.
    #[error("node {node} lies below depth {DEPTH}; OctoMap's trees have {DEPTH} levels")]
    TooDeep {
        /// Its place in pre-order.
        node: usize,
    },
    /// Masks promise more nodes than there are, or fewer.
    #[error(
        "{nodes} nodes were given, the child masks need another number; give exactly one tree in pre-order"
    )]
    Shape {
        /// How many were given.
        nodes: usize,
    },
}

/// A whole octree: edge of a voxel and nodes in pre-order. Always well-formed: finite values, masks that match the
/// nodes, at most [`DEPTH`] levels. No nodes at all is the empty map.
///
/// The root spans 65536 voxels a side, centred on the origin; child `i` of a node takes the half with the greater x
/// where bit 0 of `i` is set, y for bit 1, z for bit 2.
#[derive(Clone, Debug, PartialEq)]
pub struct OcTreeFile {
    resolution: f64,
    nodes: Vec<Node>,
}

impl OcTreeFile {
    /// A tree of `nodes` in pre-order with voxels of `resolution` metres.
    ///
    /// # Errors
    /// [`TreeError`] where the nodes are not exactly one octree (or none).
    pub fn new(resolution: f64, nodes: Vec<Node>) -> Result<Self, TreeError> {
        check(resolution, &nodes)?;
        Ok(Self { resolution, nodes })
    }

    /// A tree from a producer whose nodes are one by construction, as [`Self::new`] would check; that is done in debug
    /// builds only. Other nodes make the writers panic or write nonsense.
    pub fn assume_valid(resolution: f64, nodes: Vec<Node>) -> Self {
        debug_assert_eq!(check(resolution, &nodes), Ok(()));
        Self { resolution, nodes }
    }

    /// Edge of a voxel, metres.
    pub fn resolution(&self) -> f64 {
        self.resolution
    }

    /// The nodes in pre-order.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Index one past the last node of each node's subtree.
    pub(super) fn subtree_ends(&self) -> Vec<u32> {
        let mut ends = vec![0u32; self.nodes.len()];
        for (index, node) in self.nodes.iter().enumerate().rev() {
            let mut end = index as u32 + 1;
            for _ in 0..node.child_mask.count_ones() {
                end = ends[end as usize];
            }
            ends[index] = end;
        }
        ends
    }
}

/// What [`OcTreeFile`] promises.
fn check(resolution: f64, nodes: &[Node]) -> Result<(), TreeError> {
    if !is_resolution(resolution) {
        return Err(TreeError::Resolution(resolution));
    }
    let mut shape = Shape::default();
    for (index, node) in nodes.iter().enumerate() {
        if !node.log_odds.is_finite() {
            return Err(TreeError::LogOdds { node: index, log_odds: node.log_odds });
        }
        if index > 0 && shape.complete() {
            return Err(TreeError::Shape { nodes: nodes.len() });
        }
        shape.push(node.child_mask).map_err(|TooDeep| TreeError::TooDeep { node: index })?;
    }
    if shape.complete() { Ok(()) } else { Err(TreeError::Shape { nodes: nodes.len() }) }
}

/// Whether a number can be the edge of a voxel.
pub(super) fn is_resolution(metres: f64) -> bool {
    metres.is_finite() && metres > 0.0
}

/// A node with children at the finest level.
#[derive(Debug)]
pub(super) struct TooDeep;

/// Follows masks in pre-order: how many children each open ancestor still expects.
#[derive(Default)]
pub(super) struct Shape {
    open: [u8; DEPTH],
    depth: usize,
}

impl Shape {
    /// Takes the next node. Once [`Self::complete`], another node would start a second tree.
    pub(super) fn push(&mut self, child_mask: u8) -> Result<(), TooDeep> {
        if child_mask != 0 {
            let slot = self.open.get_mut(self.depth).ok_or(TooDeep)?;
            *slot = child_mask.count_ones() as u8;
            self.depth += 1;
            return Ok(());
        }
        // A leaf: the ancestors whose last child this was are finished, up to the first that expects another.
        while self.depth > 0 {
            let slot = &mut self.open[self.depth - 1];
            *slot -= 1;
            if *slot > 0 {
                break;
            }
            self.depth -= 1;
        }
        Ok(())
    }

    /// Whether no node is expected.
    pub(super) fn complete(&self) -> bool {
        self.depth == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEAF: Node = Node { log_odds: 1.0, child_mask: 0 };

    fn chain(inner: usize) -> Vec<Node> {
        let mut nodes = vec![Node { log_odds: 1.0, child_mask: 0b100 }; inner];
        nodes.push(LEAF);
        nodes
    }

    #[test]
    fn a_tree_has_at_most_sixteen_levels_below_its_root() {
        assert!(OcTreeFile::new(0.1, chain(16)).is_ok());
        assert_eq!(OcTreeFile::new(0.1, chain(17)), Err(TreeError::TooDeep { node: 16 }));
    }

    #[test]
    fn nodes_that_are_not_exactly_one_tree_are_refused() {
        assert!(OcTreeFile::new(0.1, vec![]).is_ok());
        assert_eq!(OcTreeFile::new(0.1, vec![LEAF; 2]), Err(TreeError::Shape { nodes: 2 }));
        let missing = vec![Node { log_odds: 1.0, child_mask: 3 }, LEAF];
        assert_eq!(OcTreeFile::new(0.1, missing), Err(TreeError::Shape { nodes: 2 }));
        let nan = vec![Node { log_odds: f32::NAN, child_mask: 0 }];
        assert!(matches!(OcTreeFile::new(0.1, nan), Err(TreeError::LogOdds { node: 0, .. })));
        assert!(matches!(OcTreeFile::new(0.0, vec![]), Err(TreeError::Resolution(_))));
    }

    #[test]
    fn the_end_of_a_subtree_is_where_the_next_sibling_starts() {
        let inner = |child_mask| Node { log_odds: 1.0, child_mask };
        let tree = OcTreeFile::new(0.1, vec![inner(0b11), inner(0b101), LEAF, LEAF, LEAF]).unwrap();
        assert_eq!(tree.subtree_ends(), [5, 4, 3, 4, 5]);
    }
}

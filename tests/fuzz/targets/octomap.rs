//! What a tree that was read must hold, `.ot` and `.bt` alike.

use std::path::Path;

use evac_formats::octomap::{BinaryValues, OcTreeFile, bt_const_bytes, ot_bytes, read_bytes};
use evac_octree::{MapConfig, OctreeMap, Pruning, SensorModel};

/// Bytes that a map may take; a leaf near the root of a hostile tree stands for 512 million bricks.
const MAX_BYTES: usize = 256 << 10;

pub fn read_and_write(bytes: &[u8]) {
    let (name, values) = (Path::new("fuzz"), BinaryValues::default());
    let direct = OctreeMap::read(bytes, name, MapConfig { max_bytes: MAX_BYTES, ..MapConfig::new(0.1) });
    let Ok(tree) = read_bytes(bytes, name, &values) else { return };
    // A node takes at least a quarter of a byte in either format.
    assert!(tree.nodes().len() <= 4 * bytes.len() + 1);
    assert!(OcTreeFile::new(tree.resolution(), tree.nodes().to_vec()).is_ok());
    let again = read_bytes(&ot_bytes(&tree), name, &values).expect("our own .ot is read");
    assert_eq!(again.nodes(), tree.nodes());
    let pruned = tree.max_likelihood_pruned(&values);
    assert!(pruned.nodes().len() <= tree.nodes().len());
    let again = read_bytes(&bt_const_bytes(&pruned, values.threshold), name, &values);
    assert_eq!(again.expect("our own .bt is read").nodes().len(), pruned.nodes().len());
    if let Ok(map) = OctreeMap::from_tree(&tree, SensorModel::default(), MAX_BYTES) {
        // Each leaf has at most sixteen nodes above it.
        assert!(map.to_tree(Pruning::Full).nodes().len() <= 17 * map.known() + 1);
        assert_eq!(map.node_count(), map.to_tree(Pruning::Full).nodes().len());
        if let Ok(direct) = direct {
            assert!(direct.voxels().eq(map.voxels()));
        }
    }
}

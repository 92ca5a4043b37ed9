//! Files that OctoMap 1.10 wrote are read and written back byte for byte.

#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::{Path, PathBuf};

use evac_formats::octomap::{
    BinaryValues, Node, OcTreeFile, bt_bytes, bt_const_bytes, ot_bytes, read, read_bytes, write_bt, write_ot,
};
use evac_testkit::data;

/// The golden sets and the values of their sensor models.
fn golden_sets() -> Option<Vec<(PathBuf, BinaryValues)>> {
    let folder = data("octomap-golden")?;
    let mut sets: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.to_string_lossy().ends_with(".const.bt"))
        .map(|path| path.with_extension("").with_extension(""))
        .map(|set| {
            let values = if set.ends_with("scan3_params") {
                BinaryValues { free: -1.386_294_4, occupied: 2.197_224_6, threshold: 0.405_465_1 }
            } else {
                BinaryValues::default()
            };
            (set, values)
        })
        .collect();
    sets.sort_by(|a, b| a.0.cmp(&b.0));
    assert_eq!(sets.len(), 15);
    Some(sets)
}

/// What follows the text.
fn body(file: &[u8]) -> &[u8] {
    let end = b"\ndata\n";
    let at = file.windows(end.len()).position(|window| window == end).unwrap();
    &file[at + end.len()..]
}

#[test]
fn golden_files_are_written_back_byte_equal() {
    let Some(sets) = golden_sets() else { return };
    let scratch = tempfile::tempdir().unwrap();
    let copy = scratch.path().join("copy");
    for (set, values) in sets {
        let ot = set.with_extension("ot");
        write_ot(&copy, &read(&ot).unwrap()).unwrap();
        assert!(fs::read(&copy).unwrap() == fs::read(&ot).unwrap(), "{}", ot.display());
        for extension in ["bt", "const.bt"] {
            let bt = set.with_extension(extension);
            let bytes = fs::read(&bt).unwrap();
            let tree = read_bytes(&bytes, &bt, &values).unwrap();
            assert!(bt_const_bytes(&tree, values.threshold) == bytes, "{}", bt.display());
        }
    }
}

#[test]
fn a_full_tree_becomes_octomaps_binary_file_byte_for_byte() {
    let Some(sets) = golden_sets() else { return };
    let scratch = tempfile::tempdir().unwrap();
    let copy = scratch.path().join("copy");
    let mut likelihood_files = 0;
    for (set, values) in sets {
        let tree = read(&set.with_extension("ot")).unwrap();
        let name = set.display();
        assert!(
            bt_const_bytes(&tree, values.threshold) == fs::read(set.with_extension("const.bt")).unwrap(),
            "{name}"
        );
        write_bt(&copy, &tree, &values).unwrap();
        assert!(fs::read(&copy).unwrap() == fs::read(set.with_extension("bt")).unwrap(), "{name}");
        if let Ok(expected) = fs::read(set.with_extension("ml.ot")) {
            assert!(ot_bytes(&tree.max_likelihood_pruned(&values)) == expected, "{name}");
            likelihood_files += 1;
        }
    }
    assert_eq!(likelihood_files, 7);
}

#[test]
fn pruning_stops_at_the_first_depth_that_merges_nothing() {
    // Eight equal leaves at depth 15 below one node of depth 14: OctoMap looks at depth 15 first, finds nothing to
    // merge there and never comes to depth 14.
    let inner = |child_mask| Node { log_odds: 1.0, child_mask };
    let leaf = Node { log_odds: 1.0, child_mask: 0 };
    let mut nodes = vec![inner(1); 14];
    nodes.push(inner(0xff));
    nodes.extend([leaf; 8]);
    let kept = OcTreeFile::new(0.1, nodes.clone()).unwrap().max_likelihood_pruned(&BinaryValues::default());
    assert_eq!(kept.nodes().len(), nodes.len());
    // With one of the eight split into eight again, depth 15 merges, and then depth 14.
    nodes[22] = inner(0xff);
    nodes.extend([leaf; 8]);
    let merged = OcTreeFile::new(0.1, nodes).unwrap().max_likelihood_pruned(&BinaryValues::default());
    assert_eq!(merged.nodes().len(), 15);
}

#[test]
fn a_real_building_of_another_lab_survives_a_round_trip() {
    let Some(path) = data("real/office_octomap/geb079.bt") else { return };
    let bytes = fs::read(&path).unwrap();
    let tree = read(&path).unwrap();
    let written = bt_const_bytes(&tree, 0.0);
    // The text in front differs from version to version.
    assert!(body(&bytes) == body(&written));
    let again = read_bytes(&written, &path, &BinaryValues::default()).unwrap();
    assert_eq!(again, tree);
    // The file was written by writeBinary, so it is its own maximum likelihood map.
    assert_eq!(
        read_bytes(&bt_bytes(&tree, &BinaryValues::default()), &path, &BinaryValues::default()).unwrap(),
        tree
    );
}

#[test]
fn the_root_of_a_binary_file_is_occupied_as_octomap_reads_it() {
    // readBinaryNode gives every inner node the upper clamp and corrects all but the root.
    let free = BinaryValues::default().free;
    let inner = Node { log_odds: free, child_mask: 1 };
    let nodes = vec![inner, inner, Node { log_odds: free, child_mask: 0 }];
    let tree = OcTreeFile::new(0.1, nodes).unwrap();
    let read_back =
        read_bytes(&bt_const_bytes(&tree, 0.0), Path::new("map.bt"), &BinaryValues::default()).unwrap();
    let values: Vec<f32> = read_back.nodes().iter().map(|node| node.log_odds).collect();
    assert_eq!(values, [BinaryValues::default().occupied, free, free]);
}

#[test]
fn a_file_without_a_text_header_is_read_as_old_versions_wrote_it() {
    let Some(sets) = golden_sets() else { return };
    let (set, values) = sets.iter().find(|(set, _)| set.ends_with("ray6")).unwrap();
    let tree = read(&set.with_extension("bt")).unwrap();
    let mut bytes = 3i32.to_le_bytes().to_vec();
    bytes.extend_from_slice(&0.05f64.to_le_bytes());
    bytes.extend_from_slice(&(tree.nodes().len() as u32).to_le_bytes());
    bytes.extend_from_slice(body(&bt_const_bytes(&tree, 0.0)));
    assert_eq!(read_bytes(&bytes, Path::new("old.bt"), values).unwrap(), tree);
}

#[test]
fn header_fields_come_in_any_order_among_comments_and_unknown_ones() {
    let mut bytes =
        b"# Octomap OcTree file, edited\nres 0.25 size 1\n# by hand\nfloor 3 size 9\n\tid 1\ndata !\n"
            .to_vec();
    bytes.extend_from_slice(&1.5f32.to_le_bytes());
    bytes.push(0);
    bytes.extend_from_slice(b"trailing bytes mean nothing");
    let tree = read_bytes(&bytes, Path::new("edited.ot"), &BinaryValues::default()).unwrap();
    assert_eq!(tree.resolution(), 0.25);
    assert_eq!(tree.nodes(), [Node { log_odds: 1.5, child_mask: 0 }]);
}

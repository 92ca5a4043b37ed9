//! Damaged `.ot` and `.bt` files give one clear error and never a panic.

#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;

use evac_formats::octomap::{BinaryValues, Node, OcTreeFile, bt_const_bytes, ot_bytes, read, read_bytes};
use evac_testkit::data;
use proptest::prelude::*;

fn message(bytes: &[u8]) -> String {
    read_bytes(bytes, Path::new("map.ot"), &BinaryValues::default()).unwrap_err().to_string()
}

fn small_tree() -> OcTreeFile {
    let leaf = |log_odds| Node { log_odds, child_mask: 0 };
    let inner = |child_mask| Node { log_odds: 1.0, child_mask };
    OcTreeFile::new(0.1, vec![inner(0b101), inner(0b11), leaf(1.0), leaf(-1.0), leaf(0.5)]).unwrap()
}

/// A small tree's file with one piece of its header replaced.
fn edited(file: &[u8], from: &str, to: &str) -> Vec<u8> {
    let at = file.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
    [&file[..at], to.as_bytes(), &file[at + from.len()..]].concat()
}

#[test]
fn each_fault_is_named_with_its_place_and_a_remedy() {
    let ot = ot_bytes(&small_tree());
    let bt = bt_const_bytes(&small_tree(), 0.0);
    let body = ot.len() - 25;
    let mut nan = ot.clone();
    nan[body + 10..body + 14].copy_from_slice(&f32::NAN.to_le_bytes());
    let chain = [b"\0\0\x80\x3f\x01".as_slice(); 17].concat();
    let deep = [&edited(&ot, "size 5", "size 18")[..body + 1], &chain].concat();
    let deep_bt = [&edited(&bt, "size 5", "size 18")[..bt.len() - 4 + 1], &[3, 0].repeat(17)].concat();
    let mut hollow = bt.clone();
    let end = hollow.len();
    hollow[end - 2..].fill(0);
    let cases: Vec<(Vec<u8>, &[&str])> = vec![
        (vec![], &["map.ot: byte 0: the file is empty"]),
        (
            b"# Octomap Oc".to_vec(),
            &["byte 12: the file ends inside its first line", "copy or write it again"],
        ),
        (
            b"# .PCD v0.7".to_vec(),
            &["byte 0: the first line is not that of an OctoMap file", "give a .ot or .bt"],
        ),
        (ot[..100].to_vec(), &["byte 100: the file ends inside its header", "cut off"]),
        (ot[..ot.len() - 1].to_vec(), &["the file ends inside the tree", "cut off"]),
        (bt[..bt.len() - 1].to_vec(), &["the file ends inside the tree", "cut off"]),
        (
            edited(&ot, "id OcTree", "id ColorOcTree"),
            &["the tree's id is ColorOcTree, not OcTree", "plain OcTree"],
        ),
        (edited(&ot, "id OcTree\n", ""), &["has no id", "add the line"]),
        (edited(&ot, "size 5\n", ""), &["has no size", "add the line"]),
        (edited(&ot, "res 0.1", "res 0"), &["resolution is missing or 0 m"]),
        (edited(&ot, "res 0.1\n", ""), &["resolution is missing"]),
        (edited(&ot, "res 0.1", "res -0.1"), &["-0.1 m"]),
        (edited(&ot, "res 0.1", "res nan"), &["NaN m"]),
        (edited(&ot, "res 0.1", "res ten"), &["\"res ten\" is not the edge of a voxel in metres"]),
        (edited(&ot, "size 5", "size 4"), &["says 4 nodes, the tree has 5"]),
        (edited(&bt, "size 5", "size 4"), &["says 4 nodes, the tree has 5"]),
        (edited(&bt, "size 5", "size 4000000000"), &["says 4000000000 nodes, the tree has 5"]),
        (edited(&ot, "size 5", "size 99999999999"), &["says 99999999999 nodes"]),
        (edited(&ot, "size 5", "size -5"), &["\"size -5\" is not a number of nodes"]),
        (nan, &["node 2 has log-odds NaN", "write it again"]),
        (deep, &["node 16 has children below depth 16"]),
        (deep_bt, &["node 16 has children below depth 16"]),
        (hollow, &["node 1 has children according to its parent, but none"]),
        (3i32.to_le_bytes().to_vec(), &["byte 4: the file ends inside its header"]),
    ];
    for (bytes, expected) in cases {
        let message = message(&bytes);
        for part in expected {
            assert!(message.contains(part), "{message:?} lacks {part:?}");
        }
        assert!(message.starts_with("map.ot: byte ") && message.contains("; "), "{message}");
    }
}

#[test]
fn a_coloured_tree_is_refused_by_name() {
    let Some(path) = data("octomap-golden/color20.ot") else { return };
    let message = read(&path).unwrap_err().to_string();
    assert!(message.contains("color20.ot") && message.contains("ColorOcTree"), "{message}");
}

#[test]
fn a_missing_file_is_named() {
    let message = read(Path::new("no/such/map.bt")).unwrap_err().to_string();
    assert!(message.contains("no/such/map.bt") && message.contains("check the path"), "{message}");
}

#[test]
fn every_cut_of_a_file_is_an_error() {
    for file in [ot_bytes(&small_tree()), bt_const_bytes(&small_tree(), 0.0)] {
        assert!(read_bytes(&file, Path::new("map"), &BinaryValues::default()).is_ok());
        for length in 0..file.len() {
            let cut = read_bytes(&file[..length], Path::new("map"), &BinaryValues::default());
            assert!(cut.is_err(), "{length} bytes");
        }
    }
}

/// Reads bytes and, where they are a tree, writes it and reads that.
fn exercise(bytes: &[u8]) {
    let values = BinaryValues::default();
    let name = Path::new("fuzz");
    let Ok(tree) = read_bytes(bytes, name, &values) else { return };
    // A node takes at least a quarter of a byte in either format.
    assert!(tree.nodes().len() <= 4 * bytes.len() + 1);
    assert!(OcTreeFile::new(tree.resolution(), tree.nodes().to_vec()).is_ok());
    let again = read_bytes(&ot_bytes(&tree), name, &values).unwrap();
    assert_eq!(again.nodes(), tree.nodes());
    let pruned = tree.max_likelihood_pruned(&values);
    assert!(pruned.nodes().len() <= tree.nodes().len());
    let again = read_bytes(&bt_const_bytes(&pruned, values.threshold), name, &values).unwrap();
    assert_eq!(again.nodes().len(), pruned.nodes().len());
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400), kind in 0usize..4) {
        let head: &[u8] = [
            &b""[..],
            b"# Octomap OcTree file\nid OcTree size 9 res 0.1 data\n",
            b"# Octomap OcTree binary file\nid OcTree size 9 res 0.1 data\n",
            &[3, 0, 0, 0],
        ][kind];
        exercise(&[head, &bytes].concat());
    }

    #[test]
    fn mutated_files_never_panic(
        edits in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 1..8),
        binary: bool,
        cut in any::<proptest::sample::Index>(),
        cuts: bool,
    ) {
        let mut bytes = match data("octomap-golden").map(|folder| folder.join("clamp")) {
            Some(set) => fs::read(set.with_extension(if binary { "bt" } else { "ot" })).unwrap(),
            None if binary => bt_const_bytes(&small_tree(), 0.0),
            None => ot_bytes(&small_tree()),
        };
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if cuts {
            bytes.truncate(cut.index(bytes.len()));
        }
        exercise(&bytes);
    }
}

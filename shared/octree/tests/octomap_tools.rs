//! OctoMap's own `convert_octree` (Debian: `octomap-tools`) reads our files and writes what we would write.

#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;
use std::process::Command;

use evac_formats::octomap::{BinaryValues, bt_bytes, ot_bytes, read_bytes};
use evac_octree::{MapConfig, OctreeMap, Pruning, Scan, ScanOptions};

/// Converts with OctoMap's tool; `None`, said aloud, where it is not installed.
fn convert(bytes: &[u8], from: &str, to: &str) -> Option<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join(from), folder.path().join(to));
    fs::write(&input, bytes).unwrap();
    match Command::new("convert_octree").arg(&input).arg(&output).output() {
        Ok(done) => {
            assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
            Some(fs::read(output).unwrap())
        }
        Err(cause) => {
            println!("skipped: convert_octree did not start ({cause}); install octomap-tools");
            None
        }
    }
}

/// A walk through a round room, until much of it is clamped and pruned.
fn walked_map(scans: usize) -> OctreeMap {
    let mut map = OctreeMap::new(MapConfig::new(0.1)).unwrap();
    for step in 0..scans {
        let origin = [0.02 * step as f32, -0.01 * step as f32, 0.1];
        let ring = |n: usize| {
            let (turn, height) = (n as f32 * 2.399_963, (n % 97) as f32 / 48.0 - 1.0);
            [3.0 * turn.cos(), 4.0 * turn.sin(), height]
        };
        let points: Vec<[f32; 3]> = (0..3000).map(ring).collect();
        let (ground, hits) = points.split_at(300);
        map.insert_scan(&Scan { origin, hits, ground, misses: &[] }, &ScanOptions::default());
    }
    map
}

#[test]
fn octomaps_tool_makes_the_same_binary_file_from_our_full_one() {
    for scans in [1, 30] {
        let tree = walked_map(scans).to_tree(Pruning::Full);
        let Some(theirs) = convert(&ot_bytes(&tree), "map.ot", "map.bt") else { return };
        assert!(bt_bytes(&tree, &BinaryValues::default()) == theirs, "{scans} scans");
    }
}

#[test]
fn octomaps_tool_makes_the_same_full_file_from_our_binary_one() {
    for scans in [1, 30] {
        let tree = walked_map(scans).to_tree(Pruning::Full);
        let binary = bt_bytes(&tree, &BinaryValues::default());
        let Some(theirs) = convert(&binary, "map.bt", "map.ot") else { return };
        let ours = read_bytes(&binary, Path::new("map.bt"), &BinaryValues::default()).unwrap();
        assert!(ot_bytes(&ours) == theirs, "{scans} scans");
    }
}

#[test]
fn octomaps_tool_reads_a_wholly_free_map_as_we_do() {
    // The root is the one node whose value OctoMap does not take from its children.
    let mut map = OctreeMap::new(MapConfig::new(0.1)).unwrap();
    map.update_node([1.0, 2.0, 3.0], false).unwrap();
    let binary = bt_bytes(&map.to_tree(Pruning::Full), &BinaryValues::default());
    let Some(theirs) = convert(&binary, "map.bt", "map.ot") else { return };
    let ours = read_bytes(&binary, Path::new("map.bt"), &BinaryValues::default()).unwrap();
    assert!(ot_bytes(&ours) == theirs);
}

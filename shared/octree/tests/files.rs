//! Files written and read without a tree between are those of the tree.

#![allow(clippy::unwrap_used)]

mod common;

use std::path::Path;

use common::{Lcg, room};
use evac_formats::octomap::{bt_bytes, ot_bytes, read_bytes};
use evac_octree::{MapConfig, MapError, OctreeMap, Pruning, ReadError};
use proptest::prelude::*;

fn compare(map: &OctreeMap) {
    let tree = map.to_tree(Pruning::Full);
    let values = map.sensor().binary_values();
    assert_eq!(map.node_count(), tree.nodes().len());
    let (full, binary) = (ot_bytes(&tree), bt_bytes(&tree, &values));
    assert!(map.ot_bytes() == full);
    assert!(map.bt_bytes() == binary);
    let config = MapConfig { sensor: *map.sensor(), ..MapConfig::new(1.0) };
    for bytes in [&full, &binary] {
        let tree = read_bytes(bytes, Path::new("map"), &values).unwrap();
        let from_tree = OctreeMap::from_tree(&tree, *map.sensor(), config.max_bytes).unwrap();
        let read = OctreeMap::read(bytes, Path::new("map"), config).unwrap();
        assert_eq!(read.space(), map.space());
        assert!(read.voxels().eq(from_tree.voxels()));
        assert_eq!((read.known(), read.voxel_count()), (from_tree.known(), from_tree.voxel_count()));
        assert!(read.to_tree(Pruning::Full) == from_tree.to_tree(Pruning::Full));
    }
    let read = OctreeMap::read(&full, Path::new("map"), config).unwrap();
    assert!(read.ot_bytes() == full);
}

#[test]
fn files_of_rooms_are_those_of_their_trees() {
    for scans in [0, 1, 4, 40] {
        compare(&room(11, scans));
    }
}

#[test]
fn a_map_with_more_values_than_numbers_has_the_same_files() {
    let mut map = room(3, 2);
    for n in 0..70_000_u32 {
        let key = [40_000 + (n % 64) as u16, 40_000 + (n / 64 % 64) as u16, 40_000 + (n / 4096) as u16];
        map.set_voxel(key, n as f32 * 1e-5 - 0.3).unwrap();
    }
    // One brick of plain values whose voxels become equal.
    for n in 0..512_u16 {
        map.set_voxel([40_056 + n % 8, 40_056 + n / 8 % 8, 40_008 + n / 64], 0.1234).unwrap();
    }
    compare(&map);
}

/// Cubes of one value each, some of them made of cubes of two values that a `.bt` does not tell apart.
fn cubes() -> impl Strategy<Value = OctreeMap> {
    let cube = (0u32..6, prop::array::uniform3(0u16..64), 0usize..6, any::<bool>());
    prop::collection::vec(cube, 1..24).prop_map(|cubes| {
        let mut map = OctreeMap::new(MapConfig::new(0.1)).unwrap();
        let values = [-2.000_028, -0.4, -1.2, 0.85, 3.511_030_7, 1.5];
        for (level, corner, value, mixed) in cubes {
            let edge = 1_u16 << level;
            let corner = corner.map(|axis| 32_768 + (axis & !(edge - 1)));
            for n in 0..u32::from(edge).pow(3) {
                let within = [0, 1, 2].map(|axis| (n >> (level * axis)) as u16 & (edge - 1));
                let key = [0, 1, 2].map(|axis| corner[axis] + within[axis]);
                let other = mixed && within.map(|axis| axis >> (level / 2)).iter().sum::<u16>() % 2 == 1;
                let value = values[if other { value / 3 * 3 + (value + 1) % 3 } else { value }];
                map.set_voxel(key, value).unwrap();
            }
        }
        map
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 120, ..ProptestConfig::default() })]

    #[test]
    fn files_are_pruned_as_far_as_octomap_prunes(map in cubes()) {
        compare(&map);
    }

    #[test]
    fn damaged_files_are_refused_or_read_as_their_trees_are(seed in any::<u64>(), edits in 1usize..4) {
        let map = room(1, 1);
        for mut bytes in [map.ot_bytes(), map.bt_bytes()] {
            let mut random = Lcg(seed);
            for _ in 0..edits {
                let at = (random.uniform() * bytes.len() as f32) as usize % bytes.len();
                bytes[at] ^= 1 << (random.uniform() * 7.9) as u32;
            }
            let config = MapConfig { max_bytes: 8 << 20, ..MapConfig::new(0.1) };
            let read = OctreeMap::read(&bytes, Path::new("map"), config);
            let tree = read_bytes(&bytes, Path::new("map"), &config.sensor.binary_values());
            match (read, tree) {
                (Ok(read), Ok(tree)) => {
                    let from_tree = OctreeMap::from_tree(&tree, config.sensor, config.max_bytes).unwrap();
                    prop_assert!(read.voxels().eq(from_tree.voxels()));
                }
                (Err(ReadError::Map { .. }), _) | (Err(_), Err(_)) => {}
                (read, tree) => prop_assert!(false, "{:?} {:?}", read.err(), tree.err()),
            }
        }
    }
}

#[test]
fn a_file_that_needs_more_than_the_ceiling_is_refused_with_its_name() {
    let config = MapConfig { max_bytes: 64 << 10, ..MapConfig::new(0.1) };
    let error = OctreeMap::read(&room(1, 5).ot_bytes(), Path::new("room.ot"), config).unwrap_err();
    assert!(
        matches!(&error, ReadError::Map { cause: MapError::TooLarge { max_bytes: 65_536 }, .. }),
        "{error}"
    );
    assert!(error.to_string().starts_with("room.ot: "));
}

//! Parts of a map asked for, taken out, joined: against the plain list of its voxels, and against its octree as files
//! have it.

#![allow(clippy::unwrap_used)]

mod common;

use std::collections::BTreeMap;

use common::{Lcg, insert, inside, room, some_box};
use evac_frames::{Voxel, voxel_flags};
use evac_octree::{Key, Leaf, MapConfig, MapError, OctreeMap, Pruning, Scan, ScanOptions, SensorModel};

fn values(map: &OctreeMap) -> BTreeMap<Key, f32> {
    map.voxels()
        .filter(|voxel| voxel.flags & voxel_flags::KNOWN != 0)
        .map(|voxel| (voxel.key, voxel.log_odds))
        .collect()
}

fn flagged(map: &OctreeMap) -> Vec<Key> {
    map.voxels().filter(|voxel| voxel.flags & voxel_flags::GROUND != 0).map(|voxel| voxel.key).collect()
}

/// The leaves of the tree that goes into files, cut at a depth.
fn leaves_of_tree(map: &OctreeMap, depth: usize) -> Vec<Leaf> {
    let tree = map.to_tree(Pruning::Full);
    let mut leaves = Vec::new();
    // Children still to come, and lowest key, of each open ancestor.
    let mut open: Vec<(u8, [u32; 3])> = Vec::new();
    for node in tree.nodes() {
        let at = open.len();
        let key = match open.last_mut() {
            Some((left, parent)) => {
                let child = left.trailing_zeros();
                *left &= *left - 1;
                let edge = 1_u32 << (16 - at);
                [0, 1, 2].map(|axis| parent[axis] + (child >> axis & 1) * edge)
            }
            None => [0; 3],
        };
        if at == depth || node.child_mask == 0 && at < depth {
            leaves.push(Leaf { key: key.map(|axis| axis as u16), depth: at as u8, log_odds: node.log_odds });
        }
        if node.child_mask != 0 {
            open.push((node.child_mask, key));
        } else {
            while open.last().is_some_and(|(left, _)| *left == 0) {
                open.pop();
            }
        }
    }
    leaves
}

#[test]
fn leaves_at_every_depth_are_those_of_octomaps_tree() {
    for scans in [1, 3, 25] {
        let map = room(7, scans);
        for depth in 1..=16 {
            let mut leaves = Vec::new();
            map.for_each_leaf(depth, |leaf| leaves.push(leaf));
            assert!(leaves == leaves_of_tree(&map, depth.into()), "{scans} scans, depth {depth}");
        }
    }
    // Large pruned leaves.
    let mut map = room(7, 1);
    for x in 0..64 {
        for y in 0..64 {
            for z in 0..32 {
                map.set_voxel([40_960 + x, 40_960 + y, 40_960 + z], -2.0).unwrap();
            }
        }
    }
    for depth in 1..=16 {
        let mut leaves = Vec::new();
        map.for_each_leaf(depth, |leaf| leaves.push(leaf));
        assert!(leaves == leaves_of_tree(&map, depth.into()), "depth {depth}");
    }
}

#[test]
fn a_box_query_tells_every_voxel_of_the_box_once_and_no_leaf_beside_it() {
    let map = room(3, 20);
    let voxels = values(&map);
    let mut random = Lcg(1);
    for edge in [1.0, 9.0, 30.0, 200.0] {
        for _ in 0..25 {
            let query = some_box(&mut random, edge);
            let mut found = BTreeMap::new();
            map.for_each_leaf_in(query.0, query.1, |leaf| {
                let edge = leaf.edge() as u16;
                let high: Key = leaf.key.map(|axis| axis + edge - 1);
                assert!((0..3).all(|axis| leaf.key[axis] <= query.1[axis] && high[axis] >= query.0[axis]));
                for n in 0..edge * edge * edge {
                    let key = [n % edge, n / edge % edge, n / edge / edge];
                    let key: Key = std::array::from_fn(|axis| leaf.key[axis] + key[axis]);
                    assert_eq!(found.insert(key, leaf.log_odds), None, "told twice");
                }
            });
            found.retain(|&key, _| inside(key, query));
            let expected: BTreeMap<_, _> = voxels
                .iter()
                .filter(|(key, _)| inside(**key, query))
                .map(|(key, value)| (*key, *value))
                .collect();
            assert_eq!(found, expected);
        }
    }
    map.for_each_leaf_in([5; 3], [4; 3], |_| unreachable!("an empty box holds nothing"));
}

#[test]
fn a_deleted_box_is_unknown_and_the_rest_stays() {
    let mut random = Lcg(2);
    for (edge, keep) in [(20.0, false), (90.0, false), (30.0, true), (90.0, true)] {
        let mut map = room(5, 8);
        let (before, ground) = (values(&map), flagged(&map));
        let cut = some_box(&mut random, edge);
        let stays = |key: &Key| inside(*key, cut) == keep;
        let deleted = if keep { map.keep_box(cut.0, cut.1) } else { map.delete_box(cut.0, cut.1) };
        let expected: BTreeMap<_, _> =
            before.iter().filter(|(key, _)| stays(key)).map(|(k, v)| (*k, *v)).collect();
        assert_eq!(values(&map), expected);
        assert_eq!(flagged(&map), ground.into_iter().filter(stays).collect::<Vec<_>>());
        assert_eq!((deleted, map.known()), (before.len() - expected.len(), expected.len()));
        assert_eq!((map.voxel_count(), map.changes().count()), (map.voxels().count(), 0));
        // What is left is a map like any other.
        insert(&mut map, 6, 2, &ScanOptions::default());
        assert_eq!(map.known(), values(&map).len());
    }
    let mut map = room(5, 2);
    map.keep_box([9; 3], [3; 3]);
    assert_eq!((map.known(), map.voxel_count(), map.bricks()), (0, 0, 0));
    assert!(map.to_tree(Pruning::Full).nodes().is_empty());
}

#[test]
fn memory_of_what_was_deleted_is_used_again() {
    let mut map = room(5, 10);
    let held = map.memory_bytes();
    for _ in 0..5 {
        map.keep_box([0; 3], [0; 3]);
        insert(&mut map, 5, 10, &ScanOptions::default());
    }
    assert!(map.memory_bytes() < held + held / 4, "{held} {}", map.memory_bytes());
}

#[test]
fn merged_maps_hold_the_clamped_sum_of_both() {
    let (mut map, other) = (room(1, 12), room(2, 6));
    let sensor = SensorModel::default();
    let mut expected = values(&map);
    for (key, update) in values(&other) {
        let value = expected.entry(key).or_insert(0.0);
        let stays =
            update >= 0.0 && *value >= sensor.clamp_max || update <= 0.0 && *value <= sensor.clamp_min;
        if !stays {
            *value = (*value + update).max(sensor.clamp_min).min(sensor.clamp_max);
        }
    }
    let mut ground = [flagged(&map), flagged(&other)].concat();
    ground.sort_unstable();
    ground.dedup();
    let report = map.merge(&other).unwrap();
    assert_eq!((report.voxels, report.refused_bricks), (other.known(), 0));
    assert_eq!(values(&map), expected);
    let mut found = flagged(&map);
    found.sort_unstable();
    assert_eq!(found, ground);
    assert_eq!((map.known(), map.voxel_count()), (expected.len(), map.voxels().count()));

    let coarse = OctreeMap::new(MapConfig::new(0.2)).unwrap();
    assert_eq!(map.merge(&coarse), Err(MapError::OtherResolution { ours: 0.1, theirs: 0.2 }));
    let mut small = OctreeMap::new(MapConfig { max_bytes: 64 << 10, ..MapConfig::new(0.1) }).unwrap();
    let report = small.merge(&other).unwrap();
    assert_eq!(report.refused_bricks, other.bricks() - small.bricks());
    assert!(
        report.refused_bricks > 0
            && small.bricks() > 0
            && small.memory_bytes() - small.free_bytes() <= 64 << 10
    );
}

#[test]
fn what_changed_since_brings_a_copy_up_to_date() {
    let mut map = room(4, 5);
    let mut copy = OctreeMap::new(MapConfig::new(0.1)).unwrap();
    map.voxels().for_each(|voxel| copy.apply(&voxel).unwrap());
    let moment = map.revision();
    let mut none = 0;
    assert!(map.for_each_changed_since(moment, |_| none += 1));
    assert_eq!(none, 0);

    let short = Scan { hits: &[[0.55, 0.05, 0.05]], ..Scan::default() };
    map.insert_scan(&short, &ScanOptions::default());
    map.set_voxel([100; 3], 1.0).unwrap();
    map.set_ground([200; 3]).unwrap();
    let mut changed: Vec<Voxel> = Vec::new();
    assert!(map.for_each_changed_since(moment, |voxel| changed.push(voxel)));
    assert!(changed.len() > 2 && changed.len() < map.voxel_count() / 10);
    changed.iter().for_each(|voxel| copy.apply(voxel).unwrap());
    assert!(map.voxels().eq(copy.voxels()));

    // After a deletion the parts do not tell it.
    let moment = map.revision();
    map.delete_box([100; 3], [100; 3]);
    assert!(!map.for_each_changed_since(moment, |_| unreachable!()));
    assert!(map.for_each_changed_since(map.revision(), |_| unreachable!()));
}

#[test]
fn what_is_not_seen_again_fades_and_is_forgotten() {
    let mut map = OctreeMap::new(MapConfig::new(0.1)).unwrap();
    let far = Scan { origin: [20.05; 3], hits: &[[22.05, 20.05, 20.05]], ..Scan::default() };
    let near = Scan { origin: [0.05; 3], hits: &[[2.05, 0.05, 0.05]], ..Scan::default() };
    let options = ScanOptions::default();
    map.insert_scan(&far, &options);
    for _ in 0..10 {
        map.insert_scan(&near, &options);
    }
    let kept: Vec<Voxel> = map.voxels().filter(|voxel| voxel.key[0] < 32_900).collect();
    let far_key = map.space().key([22.05, 20.05, 20.05]).unwrap();
    let SensorModel { hit, miss, .. } = *map.sensor();

    assert_eq!(map.fade_unseen(11, 0.1), 0);
    assert_eq!(map.fade_unseen(10, f32::NAN) + map.fade_unseen(10, -1.0), 0);
    assert_eq!(map.fade_unseen(10, 0.3), 21);
    assert_eq!(map.log_odds(far_key), Some(hit - 0.3));
    assert_eq!(map.log_odds([far_key[0] - 1, far_key[1], far_key[2]]), Some(miss + 0.3));
    // Free space is unknown again before the obstacle is.
    assert_eq!((map.fade_unseen(10, 0.3), map.known()), (21, kept.len() + 1));
    assert_eq!((map.fade_unseen(10, 0.3), map.known()), (1, kept.len()));
    assert!(map.voxels().eq(kept.iter().copied()));

    map.insert_scan(&far, &options);
    map.insert_scan(&near, &options);
    map.insert_scan(&near, &options);
    assert_eq!(map.forget_unseen(3), 0);
    assert_eq!(map.forget_unseen(2), 21);
    assert_eq!(map.known(), kept.len());
}

#[test]
fn coarse_free_space_keeps_hits_and_clears_only_blocks_that_rays_come_near() {
    let (mut exact, mut coarse) = (room(8, 0), room(8, 0));
    for seed in 0..4 {
        insert(&mut exact, seed, 1, &ScanOptions::default());
        insert(&mut coarse, seed, 1, &ScanOptions { coarse_free_space: true, ..ScanOptions::default() });
        if seed == 0 {
            let (exact, coarse) = (values(&exact), values(&coarse));
            let occupied = |map: &BTreeMap<Key, f32>| {
                map.iter().filter(|(_, value)| **value > 0.0).map(|(key, _)| *key).collect::<Vec<_>>()
            };
            assert_eq!(occupied(&exact), occupied(&coarse));
            // A coarse ray goes to the centre of its end's block, so it passes within a block of the exact one.
            let blocks: std::collections::BTreeSet<_> =
                exact.keys().map(|key| key.map(|axis| axis >> 2)).collect();
            for key in coarse.keys() {
                let block = key.map(|axis| axis >> 2);
                let near = (0..27_u16).any(|n| {
                    let shift = [n % 3, n / 3 % 3, n / 9];
                    blocks.contains(&std::array::from_fn(|axis| block[axis] + shift[axis] - 1))
                });
                assert!(near, "{key:?}");
            }
            assert!(coarse.len() > exact.len());
        }
    }
}

#[test]
fn more_values_than_the_palette_has_numbers_stay_exact() {
    // 90,000 values, each written once, in 176 full bricks and then hit and missed.
    let mut map = OctreeMap::new(MapConfig::new(0.1)).unwrap();
    let value = |n: u32| n as f32 * 1e-5 - 0.45;
    let key = |n: u32| -> Key {
        [32_768 + (n % 40) as u16, 32_768 + (n / 40 % 50) as u16, 32_768 + (n / 2000) as u16]
    };
    for n in 0..90_000 {
        map.set_voxel(key(n), value(n)).unwrap();
    }
    let hits: Vec<_> =
        (0..90_000).step_by(17).map(|n| map.space().centre(key(n)).map(|axis| axis as f32)).collect();
    let origin = map.space().centre(key(1)).map(|axis| axis as f32);
    let mut plain = values(&map);
    assert_eq!(plain.len(), 90_000);
    map.insert_scan(&Scan { origin, hits: &hits, ..Scan::default() }, &ScanOptions::default());
    let sensor = *map.sensor();
    let (mut struck, mut missed) = (0, 0);
    for (key, new) in values(&map) {
        let old = plain.remove(&key).unwrap_or(0.0);
        let (hit, miss) =
            ((old + sensor.hit).min(sensor.clamp_max), (old + sensor.miss).max(sensor.clamp_min));
        struck += u32::from(new == hit);
        missed += u32::from(new == miss);
        assert!(new == hit || new == miss || new == old, "{key:?}");
    }
    assert_eq!(struck as usize, hits.len());
    assert!(missed > 1000);
    map.delete_box([32_768; 3], [32_790; 3]);
    assert_eq!(map.known(), values(&map).len());
}

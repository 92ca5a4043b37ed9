//! What the map refuses, and what ground and silent rays do to it.

#![allow(clippy::unwrap_used)]

use evac_formats::octomap::{Node, OcTreeFile};
use evac_frames::{Voxel, voxel_flags};
use evac_octree::{
    MapConfig, MapError, Occupancy, OctreeMap, Pruning, Rejected, Scan, ScanOptions, ScanReport, SensorModel,
};

fn map(resolution: f64) -> OctreeMap {
    OctreeMap::new(MapConfig::new(resolution)).unwrap()
}

/// A map that may take little, and has taken in all far places that it can.
fn full_map(max_bytes: usize) -> OctreeMap {
    let mut map = OctreeMap::new(MapConfig { max_bytes, ..MapConfig::new(0.1) }).unwrap();
    let full = (0..8000).map(|n| map.set_voxel([n * 8, 0, 0], 1.0)).find(Result::is_err);
    assert_eq!(full, Some(Err(Rejected::Full)));
    map
}

fn at(map: &OctreeMap, point: [f32; 3]) -> Occupancy {
    map.occupancy(map.space().key(point).unwrap())
}

#[test]
fn points_that_are_no_place_are_dropped_and_counted() {
    let mut map = map(0.1);
    let hits = [
        [f32::NAN, 0.0, 0.0],
        [0.0, f32::INFINITY, 0.0],
        [0.0, 0.0, f32::NEG_INFINITY],
        [4000.0, 0.0, 0.0],
        [f32::MAX, f32::MAX, f32::MAX],
        [1.0, 0.0, 0.0],
    ];
    for discretize in [false, true] {
        let options = ScanOptions { discretize, ..ScanOptions::default() };
        let report = map.insert_scan(&Scan { hits: &hits, ..Scan::default() }, &options);
        assert_eq!((report.hits, report.not_finite, report.outside), (1, 3, 2));
        assert_eq!(report.occupied_voxels, 1);
        for origin in [[f32::NAN, 0.0, 0.0], [f32::INFINITY; 3]] {
            let report = map.insert_scan(&Scan { origin, hits: &hits, ..Scan::default() }, &options);
            assert_eq!(report, ScanReport { not_finite: 6, ..ScanReport::default() });
            assert_eq!(map.changes().count(), 0);
        }
        let origin = [0.0, 0.0, 1e6];
        let report = map.insert_scan(&Scan { origin, hits: &hits, ..Scan::default() }, &options);
        assert_eq!(report, ScanReport { outside: 6, ..ScanReport::default() });
    }
    assert!(map.voxels().all(|voxel| voxel.log_odds.is_finite()));
    assert_eq!(map.update_node([f32::NAN; 3], true), Err(Rejected::NotFinite));
    assert_eq!(map.update_node([1e9; 3], true), Err(Rejected::OutsideKeySpace));
    assert_eq!(map.set_voxel([0; 3], f32::INFINITY), Err(Rejected::NotFinite));
    assert_eq!(map.cast_ray([0.0; 3], [0.0; 3], true, None), None);
    assert_eq!(map.cast_ray([0.0; 3], [f32::NAN; 3], true, None), None);
}

#[test]
fn a_ray_too_short_for_its_length_to_be_a_number_ends() {
    // Across a border, but the squares of the components underflow.
    let mut map = map(0.1);
    let scan = Scan { origin: [-1e-30; 3], hits: &[[1e-30; 3]], ..Scan::default() };
    let report = map.insert_scan(&scan, &ScanOptions::default());
    assert_eq!((report.free_voxels, report.occupied_voxels), (0, 1));
}

#[test]
fn rays_end_at_the_edge_of_the_key_space() {
    let mut map = map(0.1);
    let corner = 3276.75;
    let scan = Scan { origin: [0.0; 3], hits: &[[corner; 3], [-corner; 3]], ..Scan::default() };
    let report = map.insert_scan(&scan, &ScanOptions::default());
    assert_eq!(report.hits, 2);
    assert_eq!(map.occupancy([65535; 3]), Occupancy::Occupied);
    let ray = map.cast_ray([3276.0, 0.05, 0.05], [1.0, 0.0, 0.0], true, None).unwrap();
    assert!(!ray.hit && ray.end[0] == 3276.75);
}

#[test]
fn a_full_map_refuses_new_places_and_still_updates_old_ones() {
    let mut map = full_map(64 << 10);
    let (bricks, at) = (map.bricks(), |key| map.space().centre(key).map(|axis| axis as f32));
    let (origin, wall, beyond) = (at([1, 0, 0]), at([3, 0, 0]), at([1, 80, 0]));
    for n in 1..20 {
        let report = map
            .insert_scan(&Scan { origin, hits: &[wall, beyond], ..Scan::default() }, &ScanOptions::default());
        assert_eq!((report.refused_bricks, map.bricks()), (10, bricks));
        let hits = map.sensor().hit * n as f32;
        assert!((map.log_odds([3, 0, 0]).unwrap() - hits.min(map.sensor().clamp_max)).abs() < 1e-5);
    }
    assert_eq!(map.log_odds([1, 80, 0]), None);
    assert_eq!(map.update_node([9.0; 3], true), Err(Rejected::Full));
    assert_eq!(map.set_ground([40_000; 3]), Err(Rejected::Full));
    // What is taken out makes room.
    map.delete_box([0; 3], [8000, 7, 7]);
    assert_eq!(map.set_ground([40_000; 3]), Ok(()));
}

#[test]
fn bricks_of_a_full_map_may_grow_within_the_ceiling() {
    let max_bytes = 1 << 20;
    let mut map = OctreeMap::new(MapConfig { max_bytes, ..MapConfig::new(0.1) }).unwrap();
    let mut refused = 0;
    for scan in 0..200_u16 {
        let origin = [0.01 * f32::from(scan), 0.0, 0.0];
        let hits: Vec<[f32; 3]> = (0..2000)
            .map(|n| {
                let (turn, height) =
                    (n as f32 * 2.399_963 + 0.1 * f32::from(scan), (n as f32 + 0.5) / 1000.0 - 1.0);
                let (flat, range) = ((1.0 - height * height).sqrt(), 9.0 + 0.1 * (n as f32 * 12.9).sin());
                [origin[0] + range * flat * turn.cos(), range * flat * turn.sin(), range * height]
            })
            .collect();
        let report =
            map.insert_scan(&Scan { origin, hits: &hits, ..Scan::default() }, &ScanOptions::default());
        refused += report.refused_bricks;
        let held = map.memory_bytes();
        assert!(held <= max_bytes, "scan {scan}: {held}");
    }
    assert!(refused > 1000 && map.memory_bytes() > max_bytes / 2);
}

#[test]
fn which_places_a_full_map_refuses_does_not_depend_on_the_order_of_points() {
    let points: Vec<[f32; 3]> = (0..40).map(|n| [n as f32 * 0.8 + 0.05, 0.05, 0.05]).collect();
    let reversed: Vec<_> = points.iter().rev().copied().collect();
    let maps = [&points, &reversed].map(|hits| {
        let mut map = full_map(64 << 10);
        // Room for some.
        map.delete_box([0; 3], [100, 7, 7]);
        let report = map.insert_scan(&Scan { hits, ..Scan::default() }, &ScanOptions::default());
        assert!(report.refused_bricks > 5 && report.refused_bricks < 35, "{report:?}");
        map
    });
    assert!(maps[0].voxels().eq(maps[1].voxels()));
}

#[test]
fn ground_is_free_and_flagged_unless_something_stands_on_it() {
    let mut map = map(0.1);
    let (floor, kerb) = ([1.05, 0.05, 0.05], [1.05, 0.55, 0.05]);
    let scan = Scan { origin: [0.05, 0.05, 1.05], ground: &[floor, kerb], hits: &[kerb], misses: &[] };
    let report = map.insert_scan(&scan, &ScanOptions::default());
    assert_eq!((report.ground, report.hits), (2, 1));
    assert_eq!(at(&map, floor), Occupancy::Free);
    assert_eq!(at(&map, kerb), Occupancy::Occupied);
    for point in [floor, kerb] {
        assert!(map.is_ground(map.space().key(point).unwrap()));
    }
    let flagged = |voxel: &Voxel| voxel.flags & voxel_flags::GROUND != 0;
    assert_eq!(map.changes().filter(flagged).count(), 2);
    assert!(!map.is_ground(map.space().key([0.55, 0.05, 0.55]).unwrap()));
    // Ground beyond the range only clears.
    let report = map.insert_scan(&scan, &ScanOptions { max_range: Some(0.5), ..ScanOptions::default() });
    assert_eq!((report.ground, report.hits, report.cleared), (0, 0, 3));
}

#[test]
fn a_ray_that_met_nothing_clears_its_way_but_not_its_end() {
    let mut map = map(0.1);
    let end = [2.05, 0.05, 0.05];
    let scan = Scan { origin: [0.05; 3], misses: &[end], ..Scan::default() };
    let report = map.insert_scan(&scan, &ScanOptions::default());
    assert_eq!((report.cleared, report.free_voxels), (1, 20));
    assert_eq!(at(&map, [1.95, 0.05, 0.05]), Occupancy::Free);
    assert_eq!(at(&map, end), Occupancy::Unknown);
}

#[test]
fn a_saturated_scene_has_no_changes() {
    let mut map = map(0.1);
    let scan = Scan { origin: [0.05; 3], hits: &[[2.05, 0.05, 0.05]], ..Scan::default() };
    for _ in 0..20 {
        map.insert_scan(&scan, &ScanOptions::default());
    }
    assert_eq!(map.changed(), 0);
    let report = map.insert_scan(&scan, &ScanOptions::default());
    assert_eq!((report.changed, report.free_voxels, report.occupied_voxels), (0, 20, 1));
}

#[test]
fn a_ground_flag_alone_leaves_a_voxel_unknown_and_out_of_the_tree() {
    let mut map = map(0.1);
    map.apply(&Voxel { key: [7; 3], flags: voxel_flags::GROUND, log_odds: 5.0 }).unwrap();
    assert_eq!(map.occupancy([7; 3]), Occupancy::Unknown);
    assert_eq!((map.known(), map.voxel_count(), map.bounds()), (0, 1, None));
    assert!(map.to_tree(Pruning::Full).nodes().is_empty());
    map.apply(&Voxel { key: [7; 3], flags: voxel_flags::KNOWN, log_odds: 5.0 }).unwrap();
    let all: Vec<Voxel> = map.voxels().collect();
    let flags = voxel_flags::GROUND | voxel_flags::KNOWN;
    assert_eq!(all, [Voxel { key: [7; 3], flags, log_odds: 5.0 }]);
    assert_eq!((map.known(), map.voxel_count()), (1, 1));
}

#[test]
fn a_tree_that_fills_the_world_is_refused_before_it_is_filled() {
    let leaf = Node { log_odds: -2.0, child_mask: 0 };
    let whole = OcTreeFile::new(0.1, vec![leaf]).unwrap();
    let refused = OctreeMap::from_tree(&whole, SensorModel::default(), 1_000_000);
    assert_eq!(refused.err(), Some(MapError::TooLarge { max_bytes: 1_000_000 }));
}

#[test]
fn a_large_leaf_fills_its_voxels_and_prunes_back_to_itself() {
    let mut nodes = vec![Node { log_odds: -2.0, child_mask: 1 << 5 }; 11];
    nodes.push(Node { log_odds: -2.0, child_mask: 0 });
    let tree = OcTreeFile::new(0.1, nodes).unwrap();
    let map = OctreeMap::from_tree(&tree, SensorModel::default(), 64 << 10).unwrap();
    assert_eq!((map.bricks(), map.known(), map.voxel_count()), (64, 32 * 32 * 32, 32 * 32 * 32));
    assert_eq!(map.to_tree(Pruning::Full), tree);
    let (min, max) = map.bounds().unwrap();
    assert_eq!(std::array::from_fn(|axis| max[axis] - min[axis]), [31u16; 3]);
}

#[test]
fn a_map_needs_a_resolution_and_room() {
    assert_eq!(OctreeMap::new(MapConfig::new(0.0)).err(), Some(MapError::Resolution(0.0)));
    let none = MapConfig { max_bytes: 1000, ..MapConfig::new(0.1) };
    assert_eq!(OctreeMap::new(none).err(), Some(MapError::Ceiling { max_bytes: 1000 }));
    let broken = SensorModel { hit: f32::NAN, ..SensorModel::default() };
    let config = MapConfig { sensor: broken, ..MapConfig::new(0.1) };
    assert!(matches!(OctreeMap::new(config).err(), Some(MapError::Sensor(_))));
}

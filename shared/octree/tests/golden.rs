//! The same insertions as OctoMap 1.10 made give the same trees, byte for byte, and the same rays.

#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::PathBuf;

use evac_formats::octomap::{OctomapBody, bt_bytes, bt_const_bytes, ot_bytes, read};
use evac_octree::{
    Bounds, Key, KeySpace, MapConfig, OcTreeFile, OctreeMap, Probabilities, Pruning, RayCast, Scan,
    ScanOptions, SensorModel,
};
use evac_testkit::data;
use serde_json::Value;

fn golden(name: &str) -> Option<PathBuf> {
    data("octomap-golden").map(|folder| folder.join(name))
}

fn json(path: PathBuf) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn point(value: &Value) -> [f32; 3] {
    std::array::from_fn(|axis| value[axis].as_f64().unwrap() as f32)
}

fn range(value: &Value) -> Option<f64> {
    value.as_f64().filter(|&metres| metres >= 0.0)
}

fn empty(resolution: f64) -> OctreeMap {
    OctreeMap::new(MapConfig::new(resolution)).unwrap()
}

type OriginAndPoints = ([f32; 3], Vec<[f32; 3]>);

/// The three scans behind the sets `scan3_*`.
fn scans() -> Option<Vec<OriginAndPoints>> {
    let file = json(golden("scan_points.json")?);
    let scan = |scan: &Value| {
        (point(&scan["origin"]), scan["points"].as_array().unwrap().iter().map(point).collect::<Vec<_>>())
    };
    Some(file["scans"].as_array().unwrap().iter().map(scan).collect())
}

fn with_scans(mut map: OctreeMap, times: usize, options: ScanOptions) -> Option<OctreeMap> {
    let scans = scans()?;
    for _ in 0..times {
        for (origin, points) in &scans {
            let report =
                map.insert_scan(&Scan { origin: *origin, hits: points, ..Scan::default() }, &options);
            assert_eq!(report.changed as usize, map.changes().count());
            assert_eq!((report.not_finite, report.outside, report.refused_bricks), (0, 0, 0));
            assert_eq!((report.hits + report.cleared) as usize, points.len());
        }
    }
    Some(map)
}

#[track_caller]
fn assert_tree(map: &OctreeMap, tree: &OcTreeFile, set: &str) {
    let Some(path) = golden(set) else { return };
    assert!(ot_bytes(tree) == fs::read(path.with_extension("ot")).unwrap(), "{set}.ot");
    let values = map.sensor().binary_values();
    let const_bt = bt_const_bytes(tree, values.threshold);
    assert!(const_bt == fs::read(path.with_extension("const.bt")).unwrap(), "{set}.const.bt");
    assert!(bt_bytes(tree, &values) == fs::read(path.with_extension("bt")).unwrap(), "{set}.bt");
}

#[track_caller]
fn assert_golden(map: Option<OctreeMap>, set: &str) {
    let Some(map) = map else { return };
    assert_tree(&map, &map.to_tree(Pruning::Full), set);
}

#[test]
fn single_updates_give_octomaps_trees() {
    assert_golden(Some(empty(0.1)), "empty");

    let mut map = empty(0.1);
    assert_eq!(map.update_node([0.05; 3], true), Ok(map.sensor().hit));
    assert_golden(Some(map), "one_hit");

    let mut map = empty(0.1);
    for corner in 0..8 {
        let at = [0, 1, 2].map(|axis| if corner >> axis & 1 == 0 { 0.05 } else { 0.15 });
        map.update_node(at, true).unwrap();
    }
    assert_tree(&map, &map.to_tree(Pruning::Full), "prune8");
    map.update_node([0.15, 0.05, 0.05], false).unwrap();
    assert_golden(Some(map), "prune8_expand");
}

#[test]
fn a_voxel_seen_often_stays_at_its_clamp() {
    let Some(path) = golden("clamp.json") else { return };
    let leaves = json(path);
    let mut map = empty(0.2);
    for (leaf, hit) in [(0, false), (1, true)] {
        let key: Key = std::array::from_fn(|axis| leaves["leaves"][leaf][axis].as_u64().unwrap() as u16);
        let centre = map.space().centre(key).map(|c| c as f32);
        for _ in 0..12 {
            map.update_node(centre, hit).unwrap();
        }
    }
    assert_golden(Some(map), "clamp");
}

#[test]
fn one_ray_cast_six_times_gives_octomaps_tree() {
    let mut map = empty(0.05);
    let scan = Scan { origin: [0.01, 0.02, 0.03], hits: &[[1.23, -0.77, 0.41]], ..Scan::default() };
    for _ in 0..6 {
        map.insert_scan(&scan, &ScanOptions::default());
    }
    assert_golden(Some(map), "ray6");
}

#[test]
fn scans_give_octomaps_trees() {
    let plain = ScanOptions::default();
    assert_golden(with_scans(empty(0.1), 1, plain), "scan3_r10");
    assert_golden(with_scans(empty(0.2), 1, plain), "scan3_r20");
    assert_golden(with_scans(empty(0.1), 1, ScanOptions { max_range: Some(2.0), ..plain }), "scan3_r10_max2");
    let discretize = ScanOptions { discretize: true, ..plain };
    assert_golden(with_scans(empty(0.1), 1, discretize), "scan3_r10_disc");
    assert_golden(with_scans(empty(0.1), 6, discretize), "scan3_r10_x6");
    let bounds = Some(Bounds { min: [-1.0, -1.0, 0.0], max: [2.0, 1.0, 2.0] });
    assert_golden(with_scans(empty(0.2), 1, ScanOptions { bounds, ..plain }), "scan3_bbx");
}

#[test]
fn lazy_insertion_leaves_octomaps_unpruned_tree() {
    let Some(map) = with_scans(empty(0.1), 1, ScanOptions::default()) else { return };
    assert_tree(&map, &map.to_tree(Pruning::None), "scan3_r10_lazy_noprune");
}

#[test]
fn another_sensor_model_gives_octomaps_tree() {
    let probabilities = Probabilities { hit: 0.8, miss: 0.45, clamp_min: 0.2, clamp_max: 0.9, occupied: 0.6 };
    let sensor = SensorModel::from_probabilities(&probabilities).unwrap();
    let map = OctreeMap::new(MapConfig { sensor, ..MapConfig::new(0.1) }).unwrap();
    assert_golden(with_scans(map, 1, ScanOptions::default()), "scan3_params");
}

#[test]
fn trees_read_from_files_become_maps_and_the_same_files_again() {
    let Some(folder) = data("octomap-golden") else { return };
    let mut sets = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if !name.ends_with(".ot") || name.ends_with(".ml.ot") || name == "color20.ot" {
            continue;
        }
        let tree = read(&path).unwrap();
        let map = OctreeMap::from_tree(&tree, SensorModel::default(), 64 << 20).unwrap();
        let pruning = if name.contains("noprune") { Pruning::None } else { Pruning::Full };
        assert!(map.to_tree(pruning) == tree, "{name}");

        let leaves = json(path.with_extension("json"));
        let mut known = 0;
        for leaf in leaves["leaves"].as_array().unwrap() {
            let key: Key = std::array::from_fn(|axis| leaf[axis].as_u64().unwrap() as u16);
            let edge = 1usize << (16 - leaf[3].as_u64().unwrap());
            let bits = leaf[4].as_u64().unwrap() as u32;
            for step in 0..edge.pow(3) {
                let within = [step % edge, step / edge % edge, step / edge / edge];
                let voxel = std::array::from_fn(|axis| key[axis] + within[axis] as u16);
                assert_eq!(map.log_odds(voxel).map(f32::to_bits), Some(bits), "{name} {voxel:?}");
            }
            known += edge.pow(3);
        }
        assert_eq!((map.known(), map.voxels().len(), map.voxels().count()), (known, known, known), "{name}");
        if let Some((min, max)) = map.bounds() {
            for axis in 0..3 {
                let half = 0.5 * map.space().resolution();
                let low = map.space().centre(min)[axis] - half;
                let high = map.space().centre(max)[axis] + half;
                assert!((low - leaves["metric_min"][axis].as_f64().unwrap()).abs() < 1e-6, "{name}");
                assert!((high - leaves["metric_max"][axis].as_f64().unwrap()).abs() < 1e-6, "{name}");
            }
        }
        sets += 1;
    }
    assert_eq!(sets, 15);
}

#[test]
fn rays_pass_through_octomaps_voxels() {
    let Some(path) = golden("raykeys.json") else { return };
    let file = json(path);
    let space = KeySpace::new(file["resolution"].as_f64().unwrap()).unwrap();
    let rays = file["rays"].as_array().unwrap();
    assert_eq!(rays.len(), 60);
    for ray in rays {
        let mut keys: Vec<Key> = Vec::new();
        assert!(space.trace(point(&ray["o"]), point(&ray["e"]), |key| keys.push(key)));
        let expected: Vec<Key> = serde_json::from_value(ray["keys"].clone()).unwrap();
        assert_eq!(keys, expected);
    }
}

#[test]
fn rays_through_the_map_end_where_octomaps_do() {
    let options = ScanOptions { discretize: true, ..ScanOptions::default() };
    let Some(map) = with_scans(empty(0.1), 1, options) else { return };
    let file = json(golden("castray.json").unwrap());
    let rays = file["rays"].as_array().unwrap();
    assert_eq!(rays.len(), 80);
    for ray in rays {
        let through = ray["ignore_unknown"].as_bool().unwrap();
        let cast = map.cast_ray(point(&ray["o"]), point(&ray["d"]), through, range(&ray["max_range"]));
        let expected = RayCast { hit: ray["hit"].as_bool().unwrap(), end: point(&ray["end"]) };
        assert_eq!(cast, Some(expected), "{ray}");
    }
}

#[test]
fn a_block_of_equal_eights_is_pruned_by_insertion_but_not_across_its_halves() {
    // golden prune_break: a block of 4 x 4 x 4 whose eight parts were hit once or twice by turns.
    let mut map = empty(0.1);
    for step in 0..64u16 {
        let within = [step % 4, step / 4 % 4, step / 16];
        let key = within.map(|axis| 32768 + axis);
        let odd = within.iter().map(|axis| axis / 2).sum::<u16>() % 2 == 1;
        let centre = map.space().centre(key).map(|c| c as f32);
        for _ in 0..if odd { 2 } else { 1 } {
            map.update_node(centre, true).unwrap();
        }
    }
    assert_golden(Some(map), "prune_break");
}

#[test]
fn maps_go_through_ros_messages_without_a_difference() {
    let Some(map) = with_scans(empty(0.1), 1, ScanOptions::default()) else { return };
    for body in [map.full_message(), map.binary_message()] {
        let path = golden(if body.binary { "scan3_r10.bt" } else { "scan3_r10.ot" }).unwrap();
        assert!(body == OctomapBody::of_file(&fs::read(&path).unwrap(), &path).unwrap());
        let received = OctreeMap::from_message(&body, MapConfig::new(0.1)).unwrap();
        let read = OctreeMap::read(&fs::read(&path).unwrap(), &path, MapConfig::new(0.1)).unwrap();
        assert!(received.voxels().eq(read.voxels()));
    }
    assert!(empty(0.1).full_message().data.is_empty() && empty(0.1).binary_message().data.is_empty());
}

//! Whole clouds: what `evac convert` does.

#![allow(clippy::unwrap_used)]

use evac_octree::{MapConfig, Occupancy, SensorModel};
use evac_octree_mapper::{
    BoundsConfig, CloudFilter, CloudFilterConfig, GroundConfig, Removed, Verdict, map_of_cloud,
};

const NOTHING: CloudFilterConfig = CloudFilterConfig {
    outliers: None,
    bounds: BoundsConfig { x_m: None, y_m: None, z_m: None, min_range_m: 0.0, max_range_m: 1000.0 },
    ground: None,
    reach_m: 1e6,
};

/// Takes the ground out; gives what stays and the counts.
fn remove_ground(points: &[[f32; 3]]) -> (Vec<[f32; 3]>, Removed) {
    let filter = CloudFilter::new(CloudFilterConfig { ground: Some(GroundConfig::default()), ..NOTHING });
    let mut rest = Vec::new();
    let mut source = points;
    let visit = |point, verdict| {
        if verdict == Verdict::Kept {
            rest.push(point);
        }
    };
    let removed = filter.unwrap().run(&mut source, visit).unwrap();
    (rest, removed)
}

/// A floor of 10 x 8 m, four pillars and a ceiling, points every 10 cm.
fn hall() -> (Vec<[f32; 3]>, usize) {
    let floor: Vec<[f32; 3]> =
        (0..100).flat_map(|x| (0..80).map(move |y| [0.1 * x as f32, 0.1 * y as f32, -1.0])).collect();
    let count = floor.len();
    let ceiling = floor.iter().map(|[x, y, _]| [*x, *y, 3.0]);
    let pillars = (0..40).flat_map(|z| {
        [[2.0, 2.0], [8.0, 2.0], [2.0, 6.0], [8.0, 6.0]].map(|[x, y]| [x, y, -0.85 + 0.1 * z as f32])
    });
    (floor.iter().copied().chain(ceiling).chain(pillars).collect(), count)
}

#[test]
fn a_point_gives_one_hit_and_no_ray() {
    let points = [[0.05, 0.05, 0.05], [0.05, 0.05, 0.05], [1.0, 2.0, 3.0]];
    let cloud = map_of_cloud(points, MapConfig::new(0.1)).unwrap();
    assert_eq!((cloud.hits, cloud.map.known()), (3, 2));
    let hit = SensorModel::default().hit;
    assert_eq!(cloud.map.log_odds(cloud.map.space().key(points[0]).unwrap()), Some(hit + hit));
    assert_eq!(cloud.map.occupancy(cloud.map.space().key(points[2]).unwrap()), Occupancy::Occupied);
}

#[test]
fn points_that_cannot_go_in_are_counted() {
    let bad = [[f32::NAN, 0.0, 0.0], [0.0, 1e9, 0.0], [0.0, f32::INFINITY, 0.0]];
    let far = (0..10_000).map(|n| [30.0 * (n % 100) as f32, 30.0 * (n / 100) as f32, 0.0]);
    let config = MapConfig { max_bytes: 1 << 20, ..MapConfig::new(0.1) };
    let cloud = map_of_cloud(bad.into_iter().chain(far), config).unwrap();
    assert_eq!((cloud.not_finite, cloud.outside, cloud.hits + cloud.full), (2, 1, 10_000));
    assert!(cloud.hits > 100 && cloud.full > 100 && cloud.map.memory_bytes() <= 1 << 20);
}

#[test]
fn the_floor_goes_and_the_rest_stays_in_its_order_wherever_the_cloud_lies() {
    // The second place has geographic coordinates, where f32 resolves 3 cm.
    for shift in [[0.0, 0.0, 0.0], [-300_000.0, 400_000.0, 35.0]] {
        let (points, floor) = hall();
        let shifted = points.iter().map(|p| std::array::from_fn(|k| p[k] + shift[k]));
        let shifted: Vec<[f32; 3]> = shifted.collect();
        let rest = shifted[floor..].to_vec();
        let (stayed, removed) = remove_ground(&shifted);
        assert_eq!(removed.ground, floor as u64, "shift {shift:?}");
        assert_eq!(stayed, rest);
    }
}

#[test]
fn every_point_is_counted_under_one_reason() {
    let (mut points, floor) = hall();
    points.insert(7, [f32::NAN; 3]);
    points.insert(9, [0.0, f32::INFINITY, 0.0]);
    points.push([2e6, 0.0, 0.0]);
    let (stayed, removed) = remove_ground(&points);
    let all = Removed {
        not_finite: 2,
        unreachable: 1,
        ground: floor as u64,
        kept: stayed.len() as u64,
        ..Removed::default()
    };
    assert_eq!(removed, all);
    assert_eq!(stayed.len() + floor + 3, points.len());
}

/// The synthetic station of the paper's Table 2: track bed at -1.2, platforms at 0, mezzanine at 4.4, all raised by
/// 0.087, with their undersides at 4.0 and the ceiling at 10.8.
#[test]
fn all_levels_of_the_station_go_and_its_ceilings_and_walls_stay() {
    let Some(path) = evac_testkit::unpacked("simulated/station/station.pcd") else { return };
    let bytes = std::fs::read(path).unwrap();
    let start = bytes.windows(12).position(|part| part == b"DATA binary\n").unwrap() + 12;
    let points: Vec<[f32; 3]> = bytes[start..]
        .chunks_exact(12)
        .map(|p| std::array::from_fn(|k| f32::from_le_bytes(p[4 * k..4 * k + 4].try_into().unwrap())))
        .collect();
    assert_eq!(points.len(), 990_768);
    let near =
        |points: &[[f32; 3]], z: f32| points.iter().filter(|p| (p[2] - z - 0.087).abs() < 0.05).count();
    let before: Vec<usize> = [-1.2, 0.0, 4.4, 4.0, 10.8].map(|z| near(&points, z)).to_vec();
    let (points, _) = remove_ground(&points);
    let after: Vec<usize> = [-1.2, 0.0, 4.4, 4.0, 10.8].map(|z| near(&points, z)).to_vec();
    for level in 0..3 {
        assert!((after[level] as f64) < 0.04 * before[level] as f64, "floor {level}: {} left", after[level]);
    }
    assert_eq!(after[3..], before[3..], "underside and ceiling");
}

//! Random scans give the same map as the plain implementation with sets, in any order of the points.

#![allow(clippy::unwrap_used)]

mod naive;

use evac_frames::{Voxel, voxel_flags};
use evac_octree::{Bounds, MapConfig, OctreeMap, Scan, ScanOptions};
use naive::{NaiveMap, NaiveScan};
use proptest::prelude::*;

type Points = Vec<[f32; 3]>;

/// Points in a room, some of them exactly on voxel borders, some of them far away.
fn points(most: usize) -> impl Strategy<Value = Points> {
    let coordinate = prop_oneof![
        6 => -6.0f32..6.0,
        2 => (-60i32..60).prop_map(|step| step as f32 * 0.1),
        1 => -3300.0f32..3300.0,
    ];
    prop::collection::vec(
        (coordinate.clone(), coordinate, -3.0f32..3.0).prop_map(|(x, y, z)| [x, y, z]),
        0..most,
    )
}

#[derive(Clone, Debug)]
struct RandomScan {
    origin: [f32; 3],
    hits: Points,
    ground: Points,
    misses: Points,
    max_range: Option<f64>,
    discretize: bool,
}

fn scans() -> impl Strategy<Value = Vec<RandomScan>> {
    let origin = prop_oneof![prop::array::uniform3(-2.0f32..2.0), Just([0.0; 3]), Just([0.1, -0.2, 0.3])];
    let scan = (origin, points(40), points(20), points(5), prop::option::of(0.05f64..20.0), any::<bool>())
        .prop_map(|(origin, hits, ground, misses, max_range, discretize)| {
            // A ray of kilometres now and then is enough.
            let max_range = max_range.or(if hits.len() % 4 == 0 { None } else { Some(30.0) });
            RandomScan { origin, hits, ground, misses, max_range, discretize }
        });
    prop::collection::vec(scan, 1..6)
}

fn insert(map: &mut OctreeMap, scan: &RandomScan) -> evac_octree::ScanReport {
    let RandomScan { origin, hits, ground, misses, max_range, discretize } = scan;
    let scan = Scan { origin: *origin, hits, ground, misses };
    map.insert_scan(
        &scan,
        &ScanOptions { max_range: *max_range, discretize: *discretize, ..ScanOptions::default() },
    )
}

fn threaded(threads: u32) -> OctreeMap {
    OctreeMap::new(MapConfig { threads, ..MapConfig::new(0.1) }).unwrap()
}

fn empty() -> OctreeMap {
    OctreeMap::new(MapConfig::new(0.1)).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, ..ProptestConfig::default() })]

    #[test]
    fn masks_in_bricks_equal_sets_of_keys(scans in scans()) {
        let mut map = empty();
        let mut naive = NaiveMap::default();
        let mut follower = empty();
        for scan in &scans {
            let before = naive.voxels.clone();
            let ground_before = naive.ground.clone();
            let report = insert(&mut map, scan);
            naive.insert(0.1, map.sensor(), &NaiveScan {
                origin: scan.origin,
                hits: &scan.hits,
                ground: &scan.ground,
                misses: &scan.misses,
                max_range: scan.max_range,
                discretize: scan.discretize,
            });
            let points = scan.hits.len() + scan.ground.len() + scan.misses.len();
            prop_assert_eq!((report.hits + report.ground + report.cleared + report.outside) as usize, points);

            // The changes are exactly the voxels that differ, each once, and carry the new state.
            let changes: Vec<Voxel> = map.changes().collect();
            prop_assert_eq!(changes.len(), map.changed());
            let mut expected: Vec<_> = naive.voxels.iter()
                .filter(|(key, value)| {
                    before.get(*key) != Some(*value)
                        || naive.ground.contains(*key) != ground_before.contains(*key)
                })
                .map(|(key, value)| (*key, *value, naive.ground.contains(key)))
                .collect();
            let mut found: Vec<_> = changes.iter()
                .map(|voxel| (voxel.key, voxel.log_odds, voxel.flags & voxel_flags::GROUND != 0))
                .collect();
            expected.sort_by_key(|a| a.0);
            found.sort_by_key(|a| a.0);
            prop_assert_eq!(found, expected);
            for voxel in &changes {
                prop_assert_eq!(follower.apply(voxel), Ok(()));
            }
        }
        prop_assert_eq!(map.known(), naive.voxels.len());
        for (key, value) in &naive.voxels {
            prop_assert_eq!(map.log_odds(*key), Some(*value));
            prop_assert_eq!(map.is_ground(*key), naive.ground.contains(key));
        }
        // A consumer that only applies the changes holds the same map.
        prop_assert!(map.voxels().eq(follower.voxels()));
        prop_assert_eq!(map.voxel_count(), map.voxels().count());
    }

    #[test]
    fn any_number_of_threads_makes_the_same_map(
        scans in scans(),
        threads in 2u32..9,
        bounds in any::<bool>(),
    ) {
        let (mut one, mut many) = (empty(), threaded(threads));
        let bounds = bounds.then_some(Bounds { min: [-3.0, -2.0, -1.0], max: [2.0, 5.0, 2.0] });
        for scan in &scans {
            let RandomScan { origin, hits, ground, misses, max_range, discretize } = scan;
            let scan = Scan { origin: *origin, hits, ground, misses };
            let options = ScanOptions { max_range: *max_range, discretize: *discretize, bounds, coarse_free_space: false };
            prop_assert_eq!(one.insert_scan(&scan, &options), many.insert_scan(&scan, &options));
            prop_assert!(one.changes().eq(many.changes()));
        }
        prop_assert!(one.voxels().eq(many.voxels()));
    }

    #[test]
    fn the_order_of_points_within_a_scan_means_nothing(
        scan in scans().prop_map(|mut scans| scans.remove(0)),
        seed in any::<u64>(),
    ) {
        let mut shuffled = scan.clone();
        for points in [&mut shuffled.hits, &mut shuffled.ground, &mut shuffled.misses] {
            let mut state = seed;
            for at in (1..points.len()).rev() {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                points.swap(at, (state >> 33) as usize % (at + 1));
            }
        }
        let (mut a, mut b) = (empty(), empty());
        prop_assert_eq!(insert(&mut a, &scan), insert(&mut b, &shuffled));
        prop_assert!(a.voxels().eq(b.voxels()));
        prop_assert!(a.changes().eq(b.changes()));
    }
}

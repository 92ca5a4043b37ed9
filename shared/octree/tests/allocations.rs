//! A scan over known ground allocates nothing. (Bricks may still grow with new values; these scans bring none.)

use evac_octree::{Bounds, MapConfig, OctreeMap, Scan, ScanOptions};
use evac_testkit::{CountingAllocator, count_allocations};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Points on a sphere's lower and upper half, seen from a walker's position.
fn sphere(count: usize, radius: f32, centre: [f32; 3]) -> Vec<[f32; 3]> {
    (0..count)
        .map(|n| {
            let (turn, height) = (n as f32 * 2.399_963, 2.0 * (n as f32 + 0.5) / count as f32 - 1.0);
            let flat = (1.0 - height * height).sqrt();
            [
                centre[0] + radius * flat * turn.cos(),
                centre[1] + radius * flat * turn.sin(),
                centre[2] + radius * height,
            ]
        })
        .collect()
}

#[test]
fn scans_and_their_changes_allocate_nothing_after_warm_up() {
    let mut map = OctreeMap::new(MapConfig::new(0.1)).unwrap();
    let walls = sphere(4000, 8.0, [0.0; 3]);
    let ground = sphere(1000, 3.0, [0.0; 3]);
    let sky = sphere(500, 12.0, [0.0; 3]);
    let bounds = Some(Bounds { min: [-5.0; 3], max: [5.0; 3] });
    let options = [
        ScanOptions::default(),
        ScanOptions { max_range: Some(6.0), ..ScanOptions::default() },
        ScanOptions { discretize: true, ..ScanOptions::default() },
        ScanOptions { bounds, ..ScanOptions::default() },
    ];
    let mut changed = 0;
    let mut run = |map: &mut OctreeMap| {
        for option in &options {
            for step in 0..3 {
                let origin = [0.1 * step as f32, 0.0, 0.0];
                let scan = Scan { origin, hits: &walls, ground: &ground, misses: &sky };
                map.insert_scan(&scan, option);
                changed += map.changes().filter(|voxel| voxel.log_odds > 0.0).count();
            }
        }
    };
    let first = count_allocations(|| run(&mut map));
    let second = count_allocations(|| run(&mut map));
    assert!(first > 0, "the counter counts");
    assert_eq!(second, 0);
    assert!(changed > 0);
}

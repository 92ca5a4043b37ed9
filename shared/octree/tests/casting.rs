//! Rays that cross empty bricks in one step end where a walk voxel by voxel ends.

#![allow(clippy::unwrap_used)]

mod common;

use common::{Lcg, insert, room, some_box};
use evac_octree::{MapConfig, Occupancy, OctreeMap, RayCast, ScanOptions, SensorModel};

/// OctoMap's `castRay`, plainly: every voxel of the walk is looked up.
fn cast_plainly(
    map: &OctreeMap,
    origin: [f32; 3],
    direction: [f32; 3],
    through_unknown: bool,
    range: Option<f64>,
) -> RayCast {
    let space = map.space();
    let mut key = space.key(origin).unwrap();
    let centre = |key| space.centre(key).map(|axis| axis as f32);
    let stop = |key| match map.occupancy(key) {
        Occupancy::Occupied => Some(true),
        Occupancy::Unknown if !through_unknown => Some(false),
        _ => None,
    };
    if let Some(hit) = stop(key) {
        return RayCast { hit, end: centre(key) };
    }
    let [x, y, z] = direction;
    let length = f64::from(x * x + y * y + z * z).sqrt() as f32;
    let (mut crossing, mut spacing, mut step) = ([f64::MAX; 3], [f64::MAX; 3], [0_i32; 3]);
    for axis in 0..3 {
        let along = direction[axis] / length;
        if along != 0.0 {
            step[axis] = if along > 0.0 { 1 } else { -1 };
            let border = space.centre(key)[axis] + f64::from(step[axis]) * space.resolution() * 0.5;
            crossing[axis] = (border - f64::from(origin[axis])) / f64::from(along);
            spacing[axis] = space.resolution() / f64::from(along).abs();
        }
    }
    loop {
        let [x, y, z] = crossing;
        let axis = if x < y {
            if x < z { 0 } else { 2 }
        } else if y < z {
            1
        } else {
            2
        };
        let Ok(next) = u16::try_from(i32::from(key[axis]) + step[axis]) else {
            return RayCast { hit: false, end: centre(key) };
        };
        key[axis] = next;
        crossing[axis] += spacing[axis];
        let end = centre(key);
        let square = |axis: usize| f64::from((end[axis] - origin[axis]) * (end[axis] - origin[axis]));
        if range.is_some_and(|range| square(0) + square(1) + square(2) > range * range) {
            return RayCast { hit: false, end };
        }
        if let Some(hit) = stop(key) {
            return RayCast { hit, end };
        }
    }
}

fn compare(map: &OctreeMap, rays: usize, seed: u64) {
    let mut random = Lcg(seed);
    let mut hits = 0;
    for n in 0..rays {
        let mut origin = random.point([5.0, 4.0, 2.0]);
        let mut direction = random.point([1.0; 3]);
        match n % 6 {
            // Along an axis, a diagonal, and from a corner, where borders are met at the same time.
            0 => direction[n / 6 % 3] = 0.0,
            1 => direction = [0, 1, 2].map(|axis| f32::from(u8::from(axis == n / 6 % 3))),
            2 => direction = direction.map(|axis| 0.5_f32.copysign(axis)),
            3 => origin = origin.map(|axis| (axis * 10.0).round() * 0.1),
            _ => {}
        }
        if direction == [0.0; 3] {
            continue;
        }
        for through_unknown in [true, false] {
            for range in [Some(3.0), Some(60.0), None] {
                let cast = map.cast_ray(origin, direction, through_unknown, range).unwrap();
                let expected = cast_plainly(map, origin, direction, through_unknown, range);
                assert_eq!(cast, expected, "{origin:?} {direction:?} {through_unknown} {range:?}");
                hits += usize::from(cast.hit);
            }
        }
    }
    assert!(hits > rays / 10, "{hits}");
}

#[test]
fn rays_that_leap_end_as_rays_that_step() {
    for scans in [1, 5, 40] {
        compare(&room(3, scans), 300, scans as u64);
    }
}

#[test]
fn rays_end_rightly_after_everything_that_changes_a_map() {
    let mut map = room(4, 10);
    let mut random = Lcg(9);
    for round in 0..4 {
        let cut = some_box(&mut random, 12.0);
        map.delete_box(cut.0, cut.1);
        // Free bricks, an occupied brick, and single voxels that become occupied and free again.
        for n in 0..1500_u16 {
            let key = [32_768 + n % 8, 32_768 + n / 8 % 8, 32_760 + n / 64];
            map.set_voxel(key, if n % 512 < 256 { -2.0 } else { 1.5 }).unwrap();
        }
        for _ in 0..200 {
            let point = random.point([4.0, 3.0, 1.5]);
            map.update_node(point, random.uniform() < 0.4).unwrap();
        }
        map.fade_unseen(1, 0.2);
        map.merge(&room(20 + round, 2)).unwrap();
        compare(&map, 120, round);
        insert(&mut map, 30 + round, 9, &ScanOptions::default());
        compare(&map, 120, 100 + round);
    }
    let copy =
        OctreeMap::from_tree(&map.to_tree(evac_octree::Pruning::Full), *map.sensor(), 1 << 30).unwrap();
    compare(&copy, 120, 7);
}

#[test]
fn a_model_that_takes_missed_voxels_for_occupied_stops_rays_at_them() {
    let sensor = SensorModel { occupied: -0.5, ..SensorModel::default() };
    let mut map = OctreeMap::new(MapConfig { sensor, ..MapConfig::new(0.1) }).unwrap();
    insert(&mut map, 5, 3, &ScanOptions::default());
    compare(&map, 200, 3);
}

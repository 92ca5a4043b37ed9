//! What stands on a floor, and what is seen of it.

use super::*;

#[test]
fn a_room_is_an_occupied_ring_with_a_free_door_and_free_inside_and_unknown_outside() {
    // The configured sensor height is wrong on purpose: it is measured from the ground under the path.
    let mut bench = Bench::with(|config| config.sensor_height_m = 2.5);
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &room(-SENSOR_HEIGHT));
    let plan = bench.plan();
    for (x, y) in steps(-1.0, 5.0).flat_map(|x| steps(-2.0, 2.0).map(move |y| (x, y))) {
        let ring = x < -0.9 || y.abs() > 1.9 || (x > 4.9 && y.abs() > 0.5);
        assert_eq!(plan.at(x, y), if ring { OCCUPIED } else { FREE }, "{x} {y}");
    }
    assert_eq!(plan.at(4.95, 0.0), FREE);
    assert_eq!(plan.count(FREE) + plan.count(OCCUPIED), 60 * 40);
    // Half a metre of margin on every side.
    assert_eq!((plan.0.width, plan.0.height), (70, 50));
    assert!((plan.0.origin[0] + 1.5).abs() < 1e-9 && (plan.0.origin[1] + 2.5).abs() < 1e-9);
}

#[test]
fn what_hangs_above_the_band_does_not_block_and_what_stands_in_it_does() {
    let mut voxels = room(-SENSOR_HEIGHT);
    for (y, solid) in [(-1.05, 1.95..2.2), (0.05, 0.25..0.4), (1.05, 0.0..0.15)] {
        for x in steps(2.0, 3.0) {
            column(&mut voxels, x, y, -SENSOR_HEIGHT, |above| solid.contains(&above));
        }
    }
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    assert_eq!(plan.at(2.55, -1.05), FREE, "a lamp 2 m above the ground");
    assert_eq!(plan.at(2.55, 0.05), OCCUPIED, "a low box");
    assert_eq!(plan.at(2.55, 1.05), FREE, "a threshold");
}

#[test]
fn a_column_of_ceiling_only_is_neither_occupied_nor_free() {
    let mut voxels = room(-SENSOR_HEIGHT);
    for (x, y) in steps(6.0, 7.0).flat_map(|x| steps(-0.5, 0.5).map(move |y| (x, y))) {
        voxels.push(voxel(x, y, -SENSOR_HEIGHT + 2.45, OCCUPIED_VALUE, voxel_flags::KNOWN));
        voxels.push(voxel(x, y, -SENSOR_HEIGHT + 2.05, FREE_VALUE, voxel_flags::KNOWN));
    }
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    assert_eq!(plan.at(6.55, 0.05), UNKNOWN);
}

#[test]
fn a_single_voxel_is_no_obstacle_and_not_free_and_a_post_is_an_obstacle() {
    let mut voxels = room(-SENSOR_HEIGHT);
    column(&mut voxels, 2.05, 1.05, -SENSOR_HEIGHT, |above| (above - 0.95).abs() < 0.01);
    column(&mut voxels, 3.05, 1.05, -SENSOR_HEIGHT, |above| above < 1.0);
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    assert_eq!(plan.at(2.05, 1.05), UNKNOWN);
    assert_eq!(plan.at(3.05, 1.05), OCCUPIED);
}

#[test]
fn space_seen_only_over_a_table_is_not_free_and_space_seen_down_to_near_the_floor_is() {
    let mut voxels = room(-SENSOR_HEIGHT);
    let air = |y: f64, heights: &[f64]| -> Vec<Voxel> {
        let each = heights.iter();
        each.map(|z| voxel(6.05, y, z - SENSOR_HEIGHT, FREE_VALUE, voxel_flags::KNOWN)).collect()
    };
    let over_a_table: Vec<f64> = steps(0.8, 1.8).collect();
    voxels.extend(air(0.05, &over_a_table));
    voxels.extend(air(0.25, &[0.05, 0.15, 0.35, 1.5]));
    voxels.extend(air(0.45, &[0.35, 0.45]));
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    assert_eq!(plan.at(6.05, 0.05), UNKNOWN, "over a table");
    assert_eq!(plan.at(6.05, 0.25), UNKNOWN, "a single ray");
    assert_eq!(plan.at(6.05, 0.45), FREE);
}

#[test]
fn gaps_too_narrow_for_anyone_are_closed_and_a_passage_is_not() {
    let mut voxels = room(-SENSOR_HEIGHT);
    for x in [2.05, 2.35, 3.05, 3.45] {
        column(&mut voxels, x, 1.05, -SENSOR_HEIGHT, |above| above < 1.0);
    }
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    assert_eq!([2.15, 2.25].map(|x| plan.at(x, 1.05)), [OCCUPIED; 2], "0.2 m");
    assert_eq!([3.15, 3.25, 3.35].map(|x| plan.at(x, 1.05)), [FREE; 3], "0.3 m");
}

#[test]
fn a_person_who_walked_away_leaves_no_trace() {
    let mut bench = Bench::new();
    let mut voxels = room(-SENSOR_HEIGHT);
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let before = bench.plan();
    let mut person = Vec::new();
    for (x, y) in steps(2.0, 2.4).flat_map(|x| steps(1.0, 1.4).map(move |y| (x, y))) {
        column(&mut person, x, y, -SENSOR_HEIGHT, |above| above < 1.7);
    }
    bench.send([4.0, 0.0, 0.0], &person, 0);
    assert_eq!(bench.plan().at(2.25, 1.25), OCCUPIED);
    voxels.retain(|voxel| person.iter().any(|other| other.key == voxel.key));
    bench.send([4.0, 0.0, 0.0], &voxels, 0);
    assert_eq!(bench.plan().0, before.0);
}

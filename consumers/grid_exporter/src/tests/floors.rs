//! Floors, stairs, ramps and storeys.

use super::*;

#[test]
fn a_stair_that_leads_down_and_a_hole_are_not_free() {
    // Behind the door a flight of steps leads down, its treads seen as obstacles from above; at y > 0.2 there is a hole
    // without anything seen below.
    let mut voxels = room(-SENSOR_HEIGHT);
    for (x, y) in steps(5.0, 7.0).flat_map(|x| steps(-0.5, 0.5).map(move |y| (x, y))) {
        let tread = if y > 0.2 { -3.0 } else { -0.17 * ((x - 5.0) / 0.28).floor() };
        if y < 0.2 {
            voxels.push(voxel(x, y, tread - SENSOR_HEIGHT - 0.01, OCCUPIED_VALUE, voxel_flags::KNOWN));
        }
        for z in steps(tread + 0.1, 1.8) {
            voxels.push(voxel(x, y, z - SENSOR_HEIGHT, FREE_VALUE, voxel_flags::KNOWN));
        }
    }
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    for x in steps(5.0, 7.0) {
        assert_eq!(plan.at(x, 0.35), UNKNOWN, "the hole at {x}");
    }
    // From the third step on, 0.5 m below the floor.
    for (x, y) in steps(5.9, 7.0).flat_map(|x| steps(-0.5, 0.1).map(move |y| (x, y))) {
        assert_eq!(plan.at(x, y), UNKNOWN, "the stair at {x} {y}");
    }
}

#[test]
fn an_even_top_too_high_to_step_on_is_an_obstacle_although_the_mapper_took_it_for_ground() {
    let mut voxels = room(-SENSOR_HEIGHT);
    for (x, y) in steps(2.0, 3.0).flat_map(|x| steps(0.5, 1.5).map(move |y| (x, y))) {
        voxels.retain(|other| other.key[..2] != voxel(x, y, 0.0, 0.0, 0).key[..2]);
        column(&mut voxels, x, y, 0.85 - SENSOR_HEIGHT, |_| false);
    }
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    for (x, y) in steps(2.0, 3.0).flat_map(|x| steps(0.5, 1.5).map(move |y| (x, y))) {
        assert_eq!(plan.at(x, y), OCCUPIED, "{x} {y}");
    }
}

#[test]
fn where_somebody_walked_is_free_although_the_floor_was_not_seen_unless_something_stands_there() {
    let mut voxels = room(-SENSOR_HEIGHT);
    wall(&mut voxels, 8.05, 0.05, -SENSOR_HEIGHT);
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [10.0, 0.0, 0.0], &voxels);
    let walked = bench.plan();
    for x in steps(5.0, 8.7) {
        let expected = if (x - 8.05).abs() < 0.01 { OCCUPIED } else { FREE };
        assert_eq!(walked.at(x, 0.05), expected, "{x}");
        assert_eq!(walked.at(x, 0.55), UNKNOWN, "beside the path at {x}");
    }
}

#[test]
fn along_a_ramp_the_band_follows_the_ground() {
    // 10 % over 20 m: at its end the ground is 2 m higher, above the whole band of its beginning.
    let rise = |x: f64| -SENSOR_HEIGHT + 0.1 * x;
    let mut voxels = Vec::new();
    for x in steps(0.0, 20.0) {
        for y in steps(-1.0, 1.0) {
            if y.abs() > 0.9 {
                wall(&mut voxels, x, y, rise(x));
            } else {
                // A ceiling 2.2 m above the ramp, and a box of 0.5 m at two places.
                let boxed = y > 0.5 && (x - 1.0).abs().min((x - 19.0).abs()) < 0.3;
                column(&mut voxels, x, y, rise(x), |above| above > 2.2 || boxed && above < 0.5);
            }
        }
    }
    let mut bench = Bench::new();
    bench.walk([0.5, 0.0, 0.05], [19.5, 0.0, 1.95], &voxels);
    let plan = bench.plan();
    for x in steps(0.0, 20.0) {
        assert_eq!(plan.at(x, 0.05), FREE, "{x}");
        assert_eq!([plan.at(x, 0.95), plan.at(x, -0.95)], [OCCUPIED; 2], "{x}");
    }
    assert_eq!([plan.at(1.05, 0.75), plan.at(19.05, 0.75)], [OCCUPIED; 2]);
    assert_eq!(plan.at(10.05, 0.75), FREE);
}

#[test]
fn a_storey_seen_later_changes_nothing_where_the_first_one_is() {
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &room(-SENSOR_HEIGHT));
    let before = bench.plan();
    // Up a flight of stairs over the room, then about on a storey 3 m higher with a wall across it.
    let mut upper = Vec::new();
    for (x, y) in steps(-0.9, 4.9).flat_map(|x| steps(-1.9, 1.9).map(move |y| (x, y))) {
        if (x - 2.05).abs() < 0.1 {
            wall(&mut upper, x, y, 3.0 - SENSOR_HEIGHT);
        } else {
            column(&mut upper, x, y, 3.0 - SENSOR_HEIGHT, |above| above > 2.4);
        }
    }
    bench.walk([4.0, 0.0, 0.0], [0.0, 0.0, 3.0], &upper);
    bench.walk([0.0, 0.0, 3.0], [4.0, 0.0, 3.0], &[]);
    assert_eq!(bench.plan().0, before.0);
}

#[test]
fn a_stair_that_was_climbed_is_free_and_the_floor_beside_it_stays_on_the_plan() {
    // A corridor from x = -1 to 10; from 4 to 7.4 m, at y < 0, a flight of ten steps to a landing from 7.4 m on.
    let tread = |x: f64| if x < 4.0 { 0.0 } else { (((x - 4.0) / 0.34).floor() + 1.0).min(10.0) * 0.17 };
    let mut voxels = Vec::new();
    for (x, y) in steps(-1.0, 10.0).flat_map(|x| steps(-1.5, 1.5).map(move |y| (x, y))) {
        if y.abs() > 1.4 {
            wall(&mut voxels, x, y, -SENSOR_HEIGHT);
        } else if y < 0.0 && tread(x) > 0.0 {
            // A stair is no ground to the mapper: its treads are occupied voxels.
            voxels.push(voxel(x, y, tread(x) - SENSOR_HEIGHT - 0.01, OCCUPIED_VALUE, voxel_flags::KNOWN));
            let above = steps(0.1, 2.6).map(|above| tread(x) - SENSOR_HEIGHT - 0.01 + above);
            voxels.extend(above.map(|z| voxel(x, y, z, FREE_VALUE, voxel_flags::KNOWN)));
        } else {
            column(&mut voxels, x, y, -SENSOR_HEIGHT, |_| false);
        }
    }
    let mut bench = Bench::new();
    bench.walk([0.0, -0.7, 0.0], [3.9, -0.7, 0.0], &voxels);
    bench.walk([3.9, -0.7, 0.0], [7.3, -0.7, 1.7], &[]);
    bench.walk([7.3, -0.7, 1.7], [9.0, -0.7, 1.7], &[]);
    let plan = bench.plan();
    for x in steps(0.0, 10.0) {
        assert_eq!(plan.at(x, -0.75), FREE, "on the way at {x}");
        assert_eq!([plan.at(x, -1.45), plan.at(x, 1.45)], [OCCUPIED; 2], "{x}");
    }
    // Seen from below the flight would be a wall; beside it the floor goes on.
    assert!(steps(0.0, 10.0).all(|x| plan.at(x, 0.75) == FREE));
}

#[test]
fn the_void_of_a_gallery_is_not_free() {
    let mut voxels = room(-SENSOR_HEIGHT);
    for (x, y) in steps(5.0, 7.0).flat_map(|x| steps(-0.5, 0.5).map(move |y| (x, y))) {
        column(&mut voxels, x, y, -SENSOR_HEIGHT - 4.0, |_| false);
        voxels.extend(steps(-1.5, 1.0).map(|z| voxel(x, y, z, FREE_VALUE, voxel_flags::KNOWN)));
    }
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    assert_eq!(bench.plan().at(6.05, 0.05), UNKNOWN);
}

#[test]
fn without_any_ground_the_band_hangs_on_the_path() {
    let voxels: Vec<_> =
        room(-SENSOR_HEIGHT).into_iter().map(|voxel| Voxel { flags: voxel_flags::KNOWN, ..voxel }).collect();
    let mut bench = Bench::with(|config| config.sensor_height_m = SENSOR_HEIGHT);
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    assert_eq!(plan.at(2.05, 0.05), FREE);
    assert_eq!(plan.at(-0.95, 0.05), OCCUPIED);
    // With the sensor taken for 4 m high the band lies below the room.
    let mut bench = Bench::with(|config| config.sensor_height_m = 4.0);
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    assert_eq!(bench.plan().count(OCCUPIED), 0);
}

use super::*;
use crate::synthetic::{Random, sheet};

/// Where the scans of these tests are seen from: 1.1 m over the floor at z = -1.1.
const SENSOR: [f64; 3] = [0.0, 0.0, 0.0];
const FLOOR: f32 = -1.1;
/// Points a square metre, as one Mid-40 frame has some 7 m away on a floor.
const DENSITY: f32 = 100.0;
const NOISE: f32 = 0.01;
/// What a wall may lose at its foot: the thickness, and half of it more where its foot tilts the local plane.
const FOOT: f32 = 0.12;

fn flat(x: [f32; 2], y: [f32; 2], z: f32, random: &mut Random) -> Vec<[f32; 3]> {
    sheet([x[0], y[0], z], [x[1] - x[0], 0.0, 0.0], [0.0, y[1] - y[0], 0.0], DENSITY, NOISE, random)
}

/// Share of the points from index `from` up to `to` that are taken as ground.
fn share(ground: &[bool], from: usize, to: usize) -> f64 {
    ground[from..to].iter().filter(|x| **x).count() as f64 / (to - from) as f64
}

/// One flag a point of a whole cloud, as [`CloudFilter`](crate::CloudFilter) reads it.
fn ground_of_cloud(points: &[[f32; 3]]) -> Vec<bool> {
    let usable = || points.iter().filter(|point| point.iter().all(|axis| axis.abs() < 1e6));
    let mut columns = GroundColumns::new(GroundConfig::default());
    usable().for_each(|point| columns.add(*point));
    let mut ground = columns.surfaces();
    usable().for_each(|point| ground.add(*point));
    ground.judge();
    points.iter().map(|point| ground.is_ground(*point)).collect()
}

fn filter() -> GroundFilter {
    GroundFilter::new(GroundConfig::default(), 0)
}

#[test]
fn a_floor_between_walls_is_ground_and_the_walls_keep_all_but_their_lowest_centimetres() {
    let mut random = Random::new(1);
    let mut points = flat([3.0, 9.0], [-1.2, 1.2], FLOOR, &mut random);
    let floor = points.len();
    for y in [-1.2, 1.2] {
        points.extend(sheet([3.0, y, FLOOR], [6.0, 0.0, 0.0], [0.0, 0.0, 2.5], 300.0, NOISE, &mut random));
    }
    let mut filter = filter();
    let ground = filter.ground_of_scan(&points, SENSOR);
    assert!(share(ground, 0, floor) > 0.995, "{}", share(ground, 0, floor));
    for (point, ground) in points.iter().zip(ground).skip(floor) {
        assert!(!ground || point[2] < FLOOR + FOOT, "wall point {point:?} taken as ground");
    }
}

#[test]
fn a_ramp_of_4_degrees_is_ground_and_one_of_40_degrees_is_not() {
    for (degrees, least, most) in [(0.0, 0.99, 1.0), (4.0, 0.99, 1.0), (15.0, 0.0, 0.0), (40.0, 0.0, 0.0)] {
        let mut random = Random::new(2);
        let rise = 6.0 * f32::tan(f32::to_radians(degrees));
        let points =
            sheet([3.0, -1.0, FLOOR], [6.0, 0.0, rise], [0.0, 2.0, 0.0], DENSITY, NOISE, &mut random);
        let mut filter = filter();
        let found = share(filter.ground_of_scan(&points, [0.0, 0.0, 4.2]), 0, points.len());
        assert!((least..=most).contains(&found), "{degrees} deg: {found}");
    }
}

#[test]
fn a_floor_passes_into_a_ramp() {
    let mut random = Random::new(12);
    let mut points = flat([3.0, 6.0], [-1.0, 1.0], FLOOR, &mut random);
    points.extend(sheet([6.0, -1.0, FLOOR], [6.0, 0.0, 0.5], [0.0, 2.0, 0.0], DENSITY, NOISE, &mut random));
    let mut filter = filter();
    assert!(share(filter.ground_of_scan(&points, SENSOR), 0, points.len()) > 0.99);
}

#[test]
fn stairs_stay_and_the_floor_at_their_foot_goes() {
    for (tread, riser) in [(0.28, 0.17), (0.3, 0.135)] {
        let mut random = Random::new(3);
        let mut points = flat([2.0, 5.0], [-1.2, 1.2], FLOOR, &mut random);
        let floor = points.len();
        for step in 0..12 {
            let (x, z) = (5.0 + tread * step as f32, FLOOR + riser * step as f32);
            points.extend(sheet([x, -1.2, z], [0.0, 2.4, 0.0], [0.0, 0.0, riser], 400.0, NOISE, &mut random));
            points.extend(sheet(
                [x, -1.2, z + riser],
                [tread, 0.0, 0.0],
                [0.0, 2.4, 0.0],
                300.0,
                NOISE,
                &mut random,
            ));
        }
        for as_scan in [true, false] {
            let mut filter = filter();
            let ground = if as_scan {
                filter.ground_of_scan(&points, [0.0, 0.0, 2.0]).to_vec()
            } else {
                ground_of_cloud(&points)
            };
            assert!(share(&ground, 0, floor) > 0.99);
            let lost =
                points.iter().zip(&ground).skip(floor).filter(|(p, g)| **g && p[2] > FLOOR + FOOT).count();
            // A low riser seen by few points may pass for a slope: one point in a hundred.
            let most = if riser < 0.15 { 0.01 } else { 0.004 } * (points.len() - floor) as f64;
            assert!(lost as f64 <= most, "riser {riser}, scan {as_scan}: {lost} of {}", points.len() - floor);
        }
    }
}

#[test]
fn two_platforms_at_different_levels_are_both_ground_but_not_the_face_between() {
    let mut random = Random::new(4);
    let mut points = flat([2.0, 6.0], [-4.0, 0.0], FLOOR, &mut random);
    points.extend(flat([2.0, 8.0], [0.0, 4.0], FLOOR - 1.2, &mut random));
    let levels = points.len();
    points.extend(sheet(
        [2.0, 0.0, FLOOR - 1.2],
        [4.0, 0.0, 0.0],
        [0.0, 0.0, 1.2],
        DENSITY,
        NOISE,
        &mut random,
    ));
    let mut filter = filter();
    let scan = filter.ground_of_scan(&points, SENSOR).to_vec();
    for ground in &[scan, ground_of_cloud(&points)] {
        assert!(share(ground, 0, levels) > 0.99, "{}", share(ground, 0, levels));
        for (point, ground) in points.iter().zip(ground).skip(levels) {
            assert!(!ground || (point[2] - FLOOR + 1.2).abs() < FOOT || (point[2] - FLOOR).abs() < FOOT);
        }
    }
}

#[test]
fn a_table_top_is_not_ground_and_the_floor_under_it_is() {
    for size in [[1.2, 0.8], [2.4, 1.2], [3.6, 1.6]] {
        let mut random = Random::new(6);
        let mut points = flat([2.5, 8.0], [-2.5, 2.5], FLOOR, &mut random);
        let floor = points.len();
        points.extend(flat([4.0, 4.0 + size[0]], [0.0, size[1]], FLOOR + 0.74, &mut random));
        // Seen by a tall person, so that the height below the sensor alone does not tell.
        let mut filter = filter();
        let scan = filter.ground_of_scan(&points, [0.0, 0.0, 0.6]).to_vec();
        for ground in &[scan, ground_of_cloud(&points)] {
            assert!(share(ground, 0, floor) > 0.99);
            assert_eq!(share(ground, floor, points.len()), 0.0, "table {size:?}");
        }
    }
}

#[test]
fn a_ceiling_is_not_ground_in_a_scan_or_in_a_cloud_of_two_storeys() {
    let mut random = Random::new(7);
    let storey = |z: f32, random: &mut Random| flat([0.0, 10.0], [0.0, 8.0], z, random);
    let mut points = storey(FLOOR, &mut random);
    let lower_floor = points.len();
    points.extend(storey(FLOOR + 2.7, &mut random));
    let lower_ceiling = points.len();
    let mut filter = filter();
    let ground = filter.ground_of_scan(&points, [5.0, 4.0, 0.0]);
    assert!(share(ground, 0, lower_floor) > 0.99);
    assert_eq!(share(ground, lower_floor, lower_ceiling), 0.0);

    points.extend(storey(FLOOR + 3.0, &mut random));
    let upper_floor = points.len();
    points.extend(storey(FLOOR + 5.7, &mut random));
    let ground = &ground_of_cloud(&points)[..];
    assert!(share(ground, 0, lower_floor) > 0.99);
    assert_eq!(share(ground, lower_floor, lower_ceiling), 0.0);
    assert!(share(ground, lower_ceiling, upper_floor) > 0.99);
    assert_eq!(share(ground, upper_floor, points.len()), 0.0);
}

#[test]
fn a_far_floor_with_too_few_points_for_planes_continues_the_near_one() {
    let mut random = Random::new(8);
    let mut points = flat([3.0, 10.0], [-2.0, 2.0], FLOOR, &mut random);
    let near = points.len();
    points.extend(sheet([12.0, -2.0, FLOOR], [4.5, 0.0, 0.0], [0.0, 4.0, 0.0], 3.0, NOISE, &mut random));
    let far = points.len();
    points.extend([[15.0, 0.0, FLOOR + 0.3], [16.0, 1.0, FLOOR + 0.9]]);
    let mut filter = filter();
    let ground = filter.ground_of_scan(&points, SENSOR);
    assert!(share(ground, near, far) > 0.97, "{}", share(ground, near, far));
    assert_eq!(ground[far..], [false, false]);
}

#[test]
fn a_strip_of_floor_before_a_near_wall_is_ground_once_the_floor_was_seen() {
    let mut random = Random::new(9);
    let mut strip = flat([3.2, 3.6], [-1.0, 1.0], FLOOR, &mut random);
    let floor = strip.len();
    strip.extend(sheet([3.6, -1.0, FLOOR], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0], 400.0, NOISE, &mut random));
    let mut filter = filter();
    assert_eq!(share(filter.ground_of_scan(&strip, SENSOR), 0, floor), 0.0);
    let seen_before = flat([0.0, 3.0], [-1.0, 1.0], FLOOR, &mut random);
    assert!(share(filter.ground_of_scan(&seen_before, SENSOR), 0, seen_before.len()) > 0.99);
    let ground = filter.ground_of_scan(&strip, SENSOR);
    assert!(share(ground, 0, floor) > 0.99);
    assert!(share(ground, floor, strip.len()) < 0.06, "only the wall's lowest 8 cm of 2 m");
}

#[test]
fn the_answer_does_not_depend_on_the_order_of_the_points() {
    let mut random = Random::new(10);
    let mut points = flat([3.0, 9.0], [-2.0, 2.0], FLOOR, &mut random);
    points.extend(sheet([5.0, 0.0, FLOOR], [0.5, 0.2, 0.0], [0.0, 0.0, 1.5], 400.0, NOISE, &mut random));
    let mut filter = filter();
    let straight = filter.ground_of_scan(&points, SENSOR).to_vec();
    points.reverse();
    let mut reversed = self::filter().ground_of_scan(&points, SENSOR).to_vec();
    reversed.reverse();
    assert_eq!(straight, reversed);
}

#[test]
fn no_points_and_points_without_numbers_are_no_ground() {
    let mut filter = filter();
    assert!(filter.ground_of_scan(&[], SENSOR).is_empty());
    assert!(ground_of_cloud(&[]).is_empty());
    let odd =
        [[f32::NAN, 0.0, 0.0], [f32::INFINITY, 0.0, 1.0], [3e38, -3e38, 0.0], [0.0, 0.0, f32::NEG_INFINITY]];
    assert_eq!(filter.ground_of_scan(&odd, SENSOR), [false; 4]);
    assert_eq!(ground_of_cloud(&odd), [false; 4]);
}

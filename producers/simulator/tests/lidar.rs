//! The simulated Mid-40, by its physics.

// Clippy's exception for tests does not reach their helpers.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;
use std::fs;

use evac_frames::Point;
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::{Point3, Vector3};
use evac_simulator::{Config, FIELD_OF_VIEW_DEG, Frame, WorldKind, direction, simulate};
use evac_stage::Rig;

/// Half a millimetre per axis of rounding on the wire, and a little for the interpolation of poses.
const WIRE_M: f64 = 0.001;
/// Edge of the cells that coverage is counted in, degrees.
const CELL_DEG: f64 = 0.25;
/// Height of the LiDAR above the floor where it is the IMU's (no lever arm), metres.
const HEIGHT: f64 = 1.2;

fn ideal() -> Config {
    Config { range_noise_m: 0.0, drop_out_share: 0.0, stray_share: 0.0, seed: 1, ..Config::default() }
}

fn frames(config: &Config, count: usize) -> Vec<Frame> {
    simulate(config, &Rig::default()).unwrap().take(count).collect()
}

fn at(point: &Point) -> Point3<f64> {
    Point3::new(f64::from(point.x), f64::from(point.y), f64::from(point.z))
}

/// Cells that the beams fall into.
fn cells(beams: &[Vector3<f64>]) -> usize {
    let cell = |x: f64| (x.asin().to_degrees() / CELL_DEG).floor() as i32;
    beams.iter().map(|beam| (cell(beam.y), cell(beam.z))).collect::<BTreeSet<_>>().len()
}

/// The maker's azimuths and elevations (a NumPy array of f32 pairs) as unit vectors.
fn makers_directions(npy: &[u8]) -> Vec<Vector3<f64>> {
    let header = 10 + usize::from(u16::from_le_bytes([npy[8], npy[9]]));
    let angles: Vec<f64> =
        npy[header..].as_chunks().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect();
    let beam = |[azimuth, elevation]: &[f64; 2]| {
        let ((sa, ca), (se, ce)) = (azimuth.sin_cos(), elevation.sin_cos());
        Vector3::new(ce * ca, ce * sa, se)
    };
    angles.as_chunks().0.iter().map(beam).collect()
}

#[test]
fn a_frame_has_ten_thousand_shots_ten_microseconds_apart_and_frames_follow_without_a_gap() {
    for (seq, frame) in frames(&Config { seed: 5, ..Config::default() }, 3).iter().enumerate() {
        assert_eq!((frame.header.frame.seq, frame.header.points), (seq as u64, 10_000));
        assert_eq!(frame.header.frame.start_ns, seq as i64 * 100_000_000);
        assert_eq!(frame.header.frame.end_ns, frame.header.frame.start_ns + 100_000_000);
        let times: Vec<i64> = frame.points.iter().map(Point::offset_ns).collect();
        assert_eq!(times, (0..10_000).map(|shot| shot * 10_000).collect::<Vec<_>>());
        let none = frame.points.iter().filter(|point| !point.is_return()).count();
        assert_eq!(frame.header.no_return as usize, none);
    }
}

#[test]
fn every_return_lies_in_the_circular_field_of_view_and_the_field_is_used_to_its_edge_and_centre() {
    let mut angles = Vec::new();
    for frame in frames(&ideal(), 5) {
        for point in frame.points.iter().filter(|point| point.is_return()) {
            let point = at(point).coords;
            // Rounding to millimetres turns a near point by up to its share.
            let slack = (WIRE_M / point.norm()).to_degrees();
            let angle = (point.x / point.norm()).acos().to_degrees();
            assert!(angle < FIELD_OF_VIEW_DEG / 2.0 + slack, "{angle} degrees off the axis");
            angles.push(angle);
        }
    }
    assert!(angles.iter().any(|angle| *angle > 19.1) && angles.iter().any(|angle| *angle < 0.2));
}

#[test]
fn the_rosette_does_not_repeat_from_frame_to_frame_and_fills_nine_tenths_of_the_field_in_a_second() {
    let ours: Vec<Vector3<f64>> = (0..100_000).map(direction).collect();
    let all = std::f64::consts::PI * (FIELD_OF_VIEW_DEG / 2.0 / CELL_DEG).powi(2);
    let (frame, second) = (cells(&ours[..10_000]) as f64 / all, cells(&ours) as f64 / all);
    assert!(frame > 0.15 && frame < 0.2, "a frame fills {frame} of the field");
    assert!(second > 0.9, "a second fills {second} of the field");
}

#[test]
fn the_rosette_is_as_dense_and_fills_the_field_as_fast_as_the_makers_pattern() {
    const RINGS: usize = 20;
    let Some(path) = evac_testkit::data("real/scan_patterns/mid40.npy") else { return };
    let maker = makers_directions(&fs::read(path).unwrap());
    let ours: Vec<Vector3<f64>> = (0..maker.len() as u64).map(direction).collect();
    let shares = |beams: &[Vector3<f64>]| {
        let mut rings = [0.0; RINGS];
        for beam in beams {
            let ring = beam.x.min(1.0).acos().to_degrees() / (FIELD_OF_VIEW_DEG / 2.0) * RINGS as f64;
            rings[(ring as usize).min(RINGS - 1)] += 1.0 / beams.len() as f64;
        }
        rings
    };
    for (ring, (ours, maker)) in shares(&ours).into_iter().zip(shares(&maker)).enumerate() {
        assert!(
            (ours / maker - 1.0).abs() < 0.03,
            "ring {ring}: {ours:.4} of the shots, the maker's {maker:.4}"
        );
    }
    for shots in [10_000, 20_000, 50_000, 100_000] {
        let (ours, maker) = (cells(&ours[..shots]), cells(&maker[..shots]));
        let ratio = ours as f64 / maker as f64;
        assert!((ratio - 1.0).abs() < 0.02, "{shots} shots fill {ours} cells, the maker's {maker}");
    }
}

#[test]
fn ranges_at_rest_are_right_to_the_millimetre_and_noisy_by_two_centimetres_along_the_beam() {
    let quiet = frames(&ideal(), 3);
    let noisy = frames(&Config { range_noise_m: 0.02, ..ideal() }, 3);
    let (mut floor, mut wall, mut count, mut sum, mut squares) = (0, 0, 0.0, 0.0, 0.0);
    for (quiet, noisy) in quiet.iter().zip(&noisy) {
        let pose = map_from_lidar(&quiet.truth);
        for (a, b) in quiet.points.iter().zip(&noisy.points) {
            if !a.is_return() || !b.is_return() {
                continue;
            }
            let place = pose * at(a);
            floor += u32::from((place.z + HEIGHT).abs() < WIRE_M);
            // The walls of the first leg are a metre to the left and right of the start.
            wall += u32::from((place.y.abs() - 1.0).abs() < WIRE_M);
            let error = at(b).coords.norm() - at(a).coords.norm();
            // The error is along the beam: across it only the wire's rounding is left.
            assert!(at(b).coords.normalize().cross(&at(a).coords).norm() < 2.0 * WIRE_M);
            count += 1.0;
            sum += error;
            squares += error * error;
        }
    }
    assert!(floor > 3000 && wall > 6000, "{floor} points on the floor, {wall} on the walls");
    let (mean, deviation): (f64, f64) = (sum / count, (squares / count).sqrt());
    assert!(mean.abs() < 0.0005, "mean {mean} m");
    assert!((deviation - 0.02).abs() < 0.0005, "standard deviation {deviation} m");
}

#[test]
fn a_turn_distorts_the_scan_and_the_pose_at_each_shots_own_time_undoes_it() {
    let mut all = simulate(&ideal(), &Rig::default()).unwrap();
    let walk = all.walk().clone();
    let frame = all.find(|frame| frame.imu.iter().any(|sample| sample.gyro[2].to_degrees() > 70.0)).unwrap();
    let end = walk.map_from_lidar(frame.header.frame.end_ns);
    let (mut sharp, mut smeared, mut returns) = (0, 0, 0);
    // Where walls of the building stand in the map frame, whose origin is 0.15 m ahead of the walker's first place.
    let on_a_wall = |p: &Point3<f64>| {
        [17.85, 15.85].iter().any(|x| (p.x - x).abs() < 2.0 * WIRE_M)
            || [-1.0, 1.0, 10.0, 12.0].iter().any(|y| (p.y - y).abs() < 2.0 * WIRE_M)
    };
    for point in frame.points.iter().filter(|point| point.is_return()) {
        let then = walk.map_from_lidar(frame.header.frame.start_ns + point.offset_ns());
        returns += 1;
        sharp += u32::from(on_a_wall(&(then * at(point))));
        smeared += u32::from(on_a_wall(&(end * at(point))));
    }
    assert!(
        returns > 9000 && sharp > 5 * smeared,
        "{sharp} points on walls with their own poses, {smeared} without"
    );
}

#[test]
fn shots_are_lost_and_strayed_at_the_configured_rates() {
    let quiet = frames(&ideal(), 20);
    let lost = frames(&Config { drop_out_share: 0.02, ..ideal() }, 20);
    let stray = frames(&Config { stray_share: 0.003, ..ideal() }, 20);
    let share = |others: &[Frame], differs: fn(&Point, &Point) -> bool| {
        let points = quiet.iter().zip(others).flat_map(|(a, b)| a.points.iter().zip(&b.points));
        points.filter(|(a, b)| differs(a, b)).count() as f64 / (20.0 * 10_000.0)
    };
    let drop_outs = share(&lost, |a, b| a.is_return() && !b.is_return());
    assert!((drop_outs - 0.02).abs() < 0.002, "{drop_outs}");
    let strays = share(&stray, |a, b| (at(a) - at(b)).norm() > 0.01);
    assert!((strays - 0.003).abs() < 0.0005, "{strays}");
}

#[test]
fn nothing_leaves_the_sensor_that_is_not_finite_or_out_of_its_range() {
    for world in [WorldKind::Corridor, WorldKind::Hall, WorldKind::Stairwell] {
        let config = Config { world, seed: 9, duration_s: Some(20.0), ..Config::default() };
        for frame in simulate(&config, &Rig::default()).unwrap().step_by(10) {
            for point in frame.points.iter().filter(|point| point.is_return()) {
                let range = at(point).coords.norm();
                assert!(
                    (config.min_range_m - 0.001..=config.max_range_m + 0.001).contains(&range),
                    "{range} m"
                );
            }
        }
    }
}

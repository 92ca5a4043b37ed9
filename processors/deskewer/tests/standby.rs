//! A standby that takes over puts out what the instance before it would have, byte for byte.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use evac_deskewer::{Deskewer, DeskewerConfig};
use evac_frames::{Point, PoseFrame};
use evac_simulator::{Config, Frame, simulate};
use evac_stage::{Counters, Rig, Stage as _};

/// Frames of the standstill at the start, in which no odometry says how the rig moves.
const START: usize = 30;

fn deskewer() -> Deskewer {
    Deskewer::new(DeskewerConfig::default(), &Rig::default()).unwrap()
}

/// The frames with the poses that the deskewer has of each.
fn walk(seconds: f64) -> Vec<(Frame, Option<PoseFrame>)> {
    walk_of(Config { seed: 3, duration_s: Some(seconds), ..Config::default() })
}

fn walk_of(config: Config) -> Vec<(Frame, Option<PoseFrame>)> {
    let frames = simulate(&config, &Rig::default()).unwrap();
    let mut prior = None;
    frames
        .enumerate()
        .map(|(index, frame)| {
            let before = prior;
            prior = (index >= START).then_some(frame.truth);
            (frame, before)
        })
        .collect()
}

/// Points of frame `cut` and the two after it, of an instance that has followed since frame `from`.
fn points(walk: &[(Frame, Option<PoseFrame>)], from: usize, cut: usize) -> Vec<Vec<Point>> {
    let mut stage = deskewer();
    let mut deskewed = Vec::new();
    for (index, (frame, prior)) in walk.iter().enumerate().take(cut + 3).skip(from) {
        let input = frame.input(prior.as_ref());
        if index < cut {
            stage.follow(input, None).unwrap();
        } else {
            deskewed.push(stage.deskew(&input, &mut Counters::default()).points().collect());
        }
    }
    deskewed
}

/// Largest difference of a coordinate, metres.
fn largest_difference(a: &[Vec<Point>], b: &[Vec<Point>]) -> f32 {
    let difference = |(a, b): (&Point, &Point)| {
        [a.x - b.x, a.y - b.y, a.z - b.z].into_iter().map(f32::abs).fold(0.0, f32::max)
    };
    a.iter().zip(b).flat_map(|(a, b)| a.iter().zip(b)).map(difference).fold(0.0, f32::max)
}

#[test]
fn with_the_pose_before_a_standby_puts_out_what_the_instance_that_led_would_have() {
    let walk = walk(12.0);
    // At rest, at the first step, and on the way; the standby has come just now or a while ago.
    for cut in [START + 1, START + 10, 60, 100] {
        let led = points(&walk, 0, cut);
        for from in [1, 5, 16] {
            assert!(points(&walk, cut - from, cut) == led, "frame {cut}, followed since {from} frames");
        }
    }
}

/// Points of frames from `first` on, of an instance that was started at frame `from` and hears its IMU from sample `sample` on.
fn started(
    walk: &[(Frame, Option<PoseFrame>)],
    (from, sample): (usize, usize),
    first: usize,
) -> Vec<Vec<Point>> {
    let mut stage = deskewer();
    let mut deskewed = Vec::new();
    for (index, (frame, prior)) in walk.iter().enumerate().skip(from) {
        let mut input = frame.input(prior.as_ref());
        if index == from {
            input.imu = &input.imu[sample..];
        }
        let points = stage.deskew(&input, &mut Counters::default()).points().collect();
        deskewed.extend((index >= first).then_some(points));
    }
    deskewed
}

#[test]
fn with_the_pose_before_an_instance_that_was_started_again_puts_out_the_same_when_the_rig_stands_later() {
    // It walks, and stands again after 45 s, while the gyroscope's firmware holds it at zero.
    let mut walk = walk_of(Config { seed: 6, duration_s: Some(48.0), ..Config::default() });
    walk.drain(..430);
    let held = walk.iter().filter(|(frame, _)| frame.imu.iter().all(|imu| imu.gyro == [0.0; 3]));
    assert!(held.count() > 10, "the rig does not stand");
    let led = started(&walk, (0, 0), 10);
    // What is remembered of the IMU begins with any sample.
    for start in [(1, 3), (4, 7), (7, 11), (9, 19)] {
        assert!(started(&walk, start, 10) == led, "started at frame and sample {start:?}");
    }
}

#[test]
fn before_the_first_pose_a_standby_has_learnt_its_bias_from_what_it_has_heard_and_is_off_by_micrometres() {
    let walk = walk(4.0);
    for (cut, from) in [(10, 5), (20, 16), (START - 1, 16)] {
        let off = largest_difference(&points(&walk, 0, cut), &points(&walk, cut - from, cut));
        println!("frame {cut}, followed since {from} frames: {:.0} um", off * 1e6);
        assert!(off > 0.0 && off < 1e-4, "frame {cut}: {off} m");
    }
}

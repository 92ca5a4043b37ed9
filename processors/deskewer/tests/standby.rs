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
    let config = Config { seed: 3, duration_s: Some(seconds), ..Config::default() };
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

#[test]
fn before_the_first_pose_a_standby_has_learnt_its_bias_from_what_it_has_heard_and_is_off_by_micrometres() {
    let walk = walk(4.0);
    for (cut, from) in [(10, 5), (20, 16), (START - 1, 16)] {
        let off = largest_difference(&points(&walk, 0, cut), &points(&walk, cut - from, cut));
        println!("frame {cut}, followed since {from} frames: {:.0} um", off * 1e6);
        assert!(off > 0.0 && off < 1e-4, "frame {cut}: {off} m");
    }
}

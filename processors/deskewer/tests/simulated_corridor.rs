//! Deskewing of a simulated walk: a real device's noise, biases, quantisation and held gyroscope, a gait, and turns on the spot.
#![allow(clippy::unwrap_used)] // helpers of tests

use evac_deskewer::{Deskewer, DeskewerConfig};
use evac_frames::{Point, PoseFrame, scan_flags};
use evac_geometry::nalgebra::{Point3, Vector3};
use evac_simulator::{Config, Frame, Walk, simulate};
use evac_stage::{Counters, Rig, Stage};

/// Rms distance between where points are said to be and where they truly are in the LiDAR frame at the scan's end, metres.
/// The noise of the ranges is the same in both and drops out.
#[derive(Debug, Clone, Copy)]
struct Smear {
    raw: f64,
    deskewed: f64,
}

fn smears(config: &Config, prior_of: impl Fn(&Frame) -> Option<PoseFrame>) -> Vec<Smear> {
    let mut rig = Rig::default();
    rig.imu_from_lidar.translation_m = [0.05, -0.03, 0.12];
    rig.imu_from_lidar.roll_pitch_yaw_deg = [1.0, -5.0, 10.0];
    let mut stage = Deskewer::new(DeskewerConfig::default(), &rig).unwrap();
    let mut counters = Counters::default();
    let frames = simulate(config, &rig).unwrap();
    let walk = frames.walk().clone();
    let (mut result, mut prior) = (Vec::new(), None);
    for frame in frames {
        let scan = stage.deskew(&frame.input(prior.as_ref()), &mut counters);
        assert_eq!(scan.header().scan_flags, scan_flags::DESKEWED);
        let returns = frame.points.iter().filter(|point| point.is_return());
        let pairs: Vec<_> = returns.zip(scan.points()).collect();
        assert_eq!(pairs.len(), scan.len());
        result.push(smear(&walk, &frame, &pairs));
        prior = prior_of(&frame);
    }
    assert_eq!(counters.degraded, 0);
    result
}

fn smear(walk: &Walk, frame: &Frame, pairs: &[(&Point, Point)]) -> Smear {
    let (start_ns, end_ns) = (frame.header.frame.start_ns, frame.header.frame.end_ns);
    let lidar_end_from_map = walk.map_from_lidar(end_ns).inverse();
    let at = |point: &Point| Point3::from(Vector3::new(point.x, point.y, point.z).map(f64::from));
    let (mut raw, mut deskewed) = (0.0, 0.0);
    for (point, moved) in pairs {
        let truth = lidar_end_from_map * walk.map_from_lidar(start_ns + point.offset_ns()) * at(point);
        raw += (at(point) - truth).norm_squared();
        deskewed += (at(moved) - truth).norm_squared();
    }
    let rms = |sum: f64| (sum / pairs.len() as f64).sqrt();
    Smear { raw: rms(raw), deskewed: rms(deskewed) }
}

fn worst(smears: &[Smear], value: impl Fn(&Smear) -> f64) -> f64 {
    smears.iter().map(value).fold(0.0, f64::max)
}

#[test]
fn with_poses_a_walk_through_a_turn_is_deskewed_to_millimetres() {
    let config = Config { seed: 11, duration_s: Some(30.0), ..Config::default() };
    let smears = smears(&config, |frame| Some(frame.truth));
    let (raw, deskewed) = (worst(&smears, |s| s.raw), worst(&smears, |s| s.deskewed));
    assert!(raw > 0.3 && deskewed < 0.005, "{raw} -> {deskewed} m");
    // The gyroscope is held at zero while the rig rests, so that the pose's bias is not in it.
    let at_rest = worst(smears.get(..25).unwrap(), |s| s.deskewed);
    assert!(at_rest < 0.0002, "{at_rest} m");
}

#[test]
fn without_poses_the_turn_is_undone_and_what_remains_is_the_way_of_one_frame() {
    let config = Config { seed: 11, duration_s: Some(30.0), ..Config::default() };
    let smears = smears(&config, |_| None);
    let turning: Vec<_> = smears.iter().copied().filter(|s| s.raw > 0.15).collect();
    assert!(turning.len() >= 6, "{turning:?}");
    assert!(worst(&turning, |s| s.deskewed / s.raw) < 0.15, "{turning:?}");
    // 1.1 m/s spread over 0.1 s before its end: an rms of 0.064 m, and the gait.
    let left = worst(&smears, |s| s.deskewed);
    assert!(left < 0.09, "{left} m");
}

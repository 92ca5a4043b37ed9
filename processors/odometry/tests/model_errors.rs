//! What the filter must survive that the sensors' data sheets do not promise: clocks that disagree, people who stand in the
//! way, starts that are none.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic as the test may")]

mod common;

use std::f64::consts::TAU;

use common::Pipeline;
use common::room::{Frame, Room, smooth};
use evac_frames::{Point, TrackingState};
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::{Isometry3, Vector3};
use evac_stage::Rig;

/// A walker who stands for two seconds and then goes 4 m along the room and back, with the sway of a gait.
fn walk(time: f64) -> Isometry3<f64> {
    let onset = smooth((time - 2.0) / 1.0);
    let way = 2.0 * (1.0 - (0.5 * (time - 2.0).max(0.0)).cos());
    let sway = Vector3::new(0.02, 0.015, 0.03) * onset;
    let phase = 11.3 * time;
    Isometry3::new(
        Vector3::new(way, 0.02 * onset * (0.5 * phase).sin(), 0.02 * onset * phase.sin()),
        Vector3::new(sway.x * phase.sin(), sway.y * (phase + 1.0).sin(), sway.z * (0.5 * phase).sin()),
    )
}

/// Stands for two seconds and is then shaken at up to 2 rad/s and 1 m/s.
fn shake(time: f64) -> Isometry3<f64> {
    let onset = smooth((time - 2.0) / 0.5);
    let swing = |hertz: f64, phase: f64| onset * (TAU * hertz * time + phase).sin();
    Isometry3::new(
        Vector3::new(0.25 * swing(0.6, 0.0), 0.2 * swing(0.7, 1.0), 0.1 * swing(0.9, 2.0)),
        Vector3::new(0.3 * swing(0.9, 0.0), 0.2 * swing(0.7, 1.0), 0.3 * swing(0.8, 2.0)),
    )
}

fn run(frames: &[Frame]) -> Pipeline {
    let mut pipeline = Pipeline::new(&Rig::default());
    frames.iter().for_each(|frame| {
        frame.feed(&mut pipeline);
    });
    pipeline
}

/// Error of the position of the last pose relative to the first that was tracked, metres.
fn end_error(pipeline: &Pipeline, frames: &[Frame]) -> f64 {
    let poses = pipeline.trajectory();
    let first = poses.iter().position(|pose| pose.state != TrackingState::Initialising as u32).unwrap();
    let estimated = map_from_lidar(&poses[first]).inverse() * map_from_lidar(poses.last().unwrap());
    let truth = frames[first].truth.inverse() * frames.last().unwrap().truth;
    (truth.inverse() * estimated).translation.vector.norm()
}

/// The IMU's stamps are ahead of the LiDAR's by this, milliseconds; samples are handed over as they come in time.
fn with_clock_ahead(frames: &[Frame], ahead_ms: i64) -> Vec<Frame> {
    let mut imu: Vec<_> = frames.iter().flat_map(|frame| frame.imu.iter().copied()).collect();
    imu.dedup_by_key(|sample| sample.stamp_ns);
    imu.iter_mut().for_each(|sample| sample.stamp_ns += ahead_ms * 1_000_000);
    let mut frames = frames.to_vec();
    for frame in &mut frames {
        // What the run loop's join hands over: the frame's time, and as far as any offset may reach.
        let span = frame.header.frame.start_ns - 130_000_000..=frame.header.frame.end_ns + 130_000_000;
        frame.imu = imu.iter().filter(|sample| span.contains(&sample.stamp_ns)).copied().collect();
    }
    frames
}

/// The offset between the clocks is found to a millisecond, whichever is ahead, and the end to so many metres.
fn assert_clock_is_found(frames: &[Frame], aheads_ms: &[i64], metres: f64) {
    for ahead_ms in aheads_ms {
        let frames = with_clock_ahead(frames, *ahead_ms);
        let pipeline = run(&frames);
        let found_ms = pipeline.trajectory().last().unwrap().time_offset_ns as f64 * 1e-6;
        assert!((found_ms + *ahead_ms as f64).abs() < 1.0, "{ahead_ms} ms ahead: {found_ms}");
        let error = end_error(&pipeline, &frames);
        assert!(error < metres, "{ahead_ms} ms ahead: {error} m");
    }
}

#[test]
fn a_clock_that_is_ahead_by_five_milliseconds_is_found_to_one() {
    assert_clock_is_found(&Room::new(31).frames(14.0, walk), &[-5, 0, 5], 0.02);
}

#[test]
fn a_clock_that_is_ahead_by_eighty_milliseconds_is_found_and_the_walk_followed() {
    assert_clock_is_found(&Room::new(32).frames(14.0, walk), &[-80, 80], 0.03);
}

#[test]
fn a_rig_that_is_shaken_at_once_is_followed_though_its_clocks_are_eighty_milliseconds_apart() {
    assert_clock_is_found(&Room::new(35).frames(10.0, shake), &[-80, 80], 0.02);
}

#[test]
fn somebody_half_a_metre_before_the_sensor_for_three_seconds_is_not_mapped() {
    let mut frames = Room::new(33).frames(12.0, walk);
    for frame in frames.iter_mut().skip(50).take(30) {
        for point in &mut frame.points {
            let range = Vector3::new(point.x, point.y, point.z).norm();
            let share = 0.5 / range;
            *point = Point::new(point.x * share, point.y * share, point.z * share, point.offset_ns(), 100);
        }
    }
    let pipeline = run(&frames);
    assert_eq!(pipeline.odometry.diagnostics().losses, 0);
    let hidden = &pipeline.trajectory()[55..75];
    assert!(hidden.iter().all(|pose| pose.state == TrackingState::Degenerate as u32 && pose.degenerate == 3));
    let metres = end_error(&pipeline, &frames);
    assert!(metres < 0.03, "{metres} m");
}

#[test]
fn a_rig_that_glides_steadily_is_not_taken_for_standing_because_its_imu_is_at_rest() {
    let room = Room { max: Vector3::new(16.0, 1.5, 1.8), ..Room::new(34) };
    let frames = room.frames(10.0, |time| Isometry3::translation(0.9 * time, 0.0, 0.0));
    let pipeline = run(&frames);
    assert!(!pipeline.odometry.diagnostics().started_standing);
    let metres = end_error(&pipeline, &frames);
    assert!(metres < 0.1, "{metres} m");
}

#[test]
fn a_start_in_motion_before_a_blank_wall_waits_until_the_velocity_is_seen() {
    let room =
        Room { min: Vector3::new(-6.0, -1.2, -1.2), max: Vector3::new(9.0, 1.2, 1.8), ..Room::new(35) };
    // Sidles along the wall at its left for seven seconds, then turns into the room.
    let frames = room.frames(16.0, |time| {
        let yaw = std::f64::consts::FRAC_PI_2 * (1.0 - smooth((time - 7.0) / 2.0));
        let gait = Vector3::new(0.0, 0.0, 0.02 * (11.3 * time).sin());
        Isometry3::new(
            Vector3::x() * (0.4 * time - 3.0) + gait,
            Vector3::z() * (yaw + 0.01 * (11.3 * time).sin()),
        )
    });
    let pipeline = run(&frames);
    let first = pipeline.trajectory().iter().position(|pose| pose.state != 0).unwrap();
    assert!((70..110).contains(&first), "first pose at frame {first}");
    let metres = end_error(&pipeline, &frames);
    assert!(metres < 0.2, "{metres} m");
}

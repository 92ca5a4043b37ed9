//! Starts in motion: the recording begins while the rig is carried already.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic as the test may")]

mod common;

use common::room::{Frame, Room, smooth};
use common::{Pipeline, position_sigma};
use evac_frames::TrackingState;
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::{Isometry3, Vector3};
use evac_stage::Rig;

/// What a walker's gait adds to a motion at `time`, `share` of it.
fn gait(time: f64, share: f64) -> Isometry3<f64> {
    Isometry3::new(
        Vector3::new(0.0, 0.02 * (11.0 * time).sin(), 0.02 * (9.0 * time).cos()) * share,
        Vector3::new(0.02, 0.01, 0.03) * ((7.0 * time).sin() * share),
    )
}

fn run(frames: &[Frame]) -> Pipeline {
    let mut pipeline = Pipeline::new(&Rig::default());
    for frame in frames {
        frame.feed(&mut pipeline);
    }
    pipeline
}

/// Length of the error of the last position relative to the first that was tracked, metres, and the angle between the map's z and the
/// true vertical there, degrees.
fn end_error(pipeline: &Pipeline, frames: &[Frame]) -> (f64, f64) {
    let poses = pipeline.trajectory();
    let first = poses.iter().position(|pose| pose.state != TrackingState::Initialising as u32).unwrap();
    let (start, end) = (map_from_lidar(&poses[first]), map_from_lidar(poses.last().unwrap()));
    let truth = frames.last().unwrap().truth;
    let way = (frames[first].truth.inverse() * truth).translation.vector;
    let up = |pose: &Isometry3<f64>| pose.rotation.inverse() * Vector3::z();
    let error = (start.inverse() * end).translation.vector - way;
    (error.norm(), up(&end).angle(&up(&truth)).to_degrees())
}

#[test]
fn a_cart_that_rolls_on_steadily_from_the_start_is_not_taken_for_standing() {
    // Shaken at first; from 3.3 s on an IMU could as well be at rest.
    let frames = Room { max: Vector3::new(20.0, 3.0, 1.8), ..Room::new(31) }.frames(12.0, |time| {
        Isometry3::translation(0.9 * time, 0.0, 0.0) * gait(time, 1.0 - smooth((time - 2.8) / 0.5))
    });
    let pipeline = run(&frames);
    assert!(!pipeline.odometry.diagnostics().started_standing);
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.1 && degrees < 1.0, "{metres} m, {degrees} deg");
}

#[test]
fn a_walker_who_comes_to_stand_before_a_wall_starts_from_that_standstill() {
    // Nothing but the wall is seen until he has turned away from it.
    let room =
        Room { min: Vector3::new(-6.0, -1.8, -1.2), max: Vector3::new(1.2, 1.8, 1.8), ..Room::new(32) };
    let frames = room.frames(12.0, |time| {
        let way =
            if time < 3.2 { 0.8 * time } else { 0.8 * (3.2 + 0.4 * (1.0 - (-(time - 3.2) / 0.4).exp())) };
        let back = smooth((time - 8.0) / 2.0);
        let share = 1.0 - smooth((time - 3.2) / 1.0);
        Isometry3::new(Vector3::x() * (way - 2.88), Vector3::z() * (1.5 * back)) * gait(time, share)
    });
    let pipeline = run(&frames);
    assert!(pipeline.odometry.diagnostics().started_standing);
    let (metres, degrees) = end_error(&pipeline, &frames);
    let sigma = position_sigma(pipeline.trajectory().last().unwrap());
    assert!(metres < 0.05 && metres < 3.0 * sigma, "{metres} m against {sigma} m");
    assert!(degrees < 0.4, "{degrees} deg");
}

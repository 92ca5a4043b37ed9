//! What the odometry must do in a box room whose truth is known.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic as the test may")]

mod common;

use std::f64::consts::FRAC_PI_2;

use common::room::{Room, glide, smooth};
use common::truth::{end_error, error_at, is_finite, odometry_alone, run};
use common::{Pipeline, position_sigma};
use evac_frames::TrackingState;
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3};
use evac_odometry::{Lio, LioConfig};
use evac_stage::Rig;

#[test]
fn a_known_motion_through_a_box_room_is_followed_to_a_centimetre() {
    let frames = Room::new(1).frames(8.0, glide(Vector3::new(1.5, -0.8, 0.2), 0.6, 5.0));
    let pipeline = run(&frames);
    for index in 15..frames.len() {
        let (metres, degrees) = error_at(pipeline.trajectory(), &frames, index);
        assert!(metres < 0.01 && degrees < 0.1, "frame {index}: {metres} m, {degrees} deg");
    }
}

#[test]
fn every_scan_gives_one_pose_with_its_own_header() {
    let frames = Room::new(2).frames(3.0, glide(Vector3::new(0.3, 0.0, 0.0), 0.0, 1.0));
    let pipeline = run(&frames);
    assert_eq!(pipeline.trajectory().len(), frames.len());
    for (pose, frame) in pipeline.trajectory().iter().zip(&frames) {
        assert_eq!(pose.frame, frame.header.frame);
        assert!(is_finite(pose) && pose.tracking_state().is_some());
    }
}

#[test]
fn a_standing_rig_does_not_drift_though_its_gyroscope_reads_zeros() {
    for auto_zero in [false, true] {
        let frames = Room { auto_zero, ..Room::new(3) }.frames(20.0, |_| Isometry3::identity());
        let (metres, degrees) = end_error(&run(&frames), &frames);
        assert!(metres < 0.003 && degrees < 0.05, "{metres} m, {degrees} deg, auto-zero {auto_zero}");
    }
}

#[test]
fn a_rig_that_stands_before_a_blank_wall_does_not_glide_along_it() {
    for auto_zero in [false, true] {
        let room = Room { max: Vector3::new(1.2, 1.5, 1.8), auto_zero, ..Room::new(23) };
        let frames = room.frames(30.0, |_| Isometry3::identity());
        let (metres, degrees) = end_error(&run(&frames), &frames);
        assert!(metres < 0.02 && degrees < 0.3, "{metres} m, {degrees} deg, auto-zero {auto_zero}");
    }
}

#[test]
fn a_rig_that_turns_to_and_fro_on_the_spot_before_a_blank_wall_stays_there() {
    let room = Room { max: Vector3::new(1.2, 1.5, 1.8), ..Room::new(24) };
    let frames = room.frames(25.0, |time| {
        let phase = (time - 2.0).max(0.0);
        let sway = 0.01 * (0.5 * phase).sin();
        let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.06 * (1.3 * phase).sin());
        Isometry3::from_parts(Translation3::new(0.0, sway, sway / 2.0), turn)
    });
    let (metres, degrees) = end_error(&run(&frames), &frames);
    assert!(metres < 0.06 && degrees < 0.3, "{metres} m, {degrees} deg");
}

#[test]
fn a_rig_that_creeps_along_a_blank_wall_is_not_stopped() {
    let room = Room { max: Vector3::new(1.2, 3.5, 1.8), ..Room::new(25) };
    // Up to 8 cm/s within half a second, on wheels that shake the rig.
    let frames = room.frames(6.0, |time| {
        let since = (time - 2.0).max(0.0);
        let shaken = 2e-4 * (50.0 * since).sin();
        Isometry3::translation(0.0, 0.08 * (since - 0.3 * (1.0 - (-since / 0.3).exp())), shaken)
    });
    let pipeline = run(&frames);
    let (metres, _) = end_error(&pipeline, &frames);
    let sigma = position_sigma(pipeline.trajectory().last().unwrap());
    assert!(metres < 0.2 && metres < 3.0 * sigma, "{metres} m, {sigma} m");
}

#[test]
fn a_bias_hidden_by_auto_zero_is_found_in_motion() {
    let bias = Vector3::new(0.004, -0.008, 0.006);
    let room = Room { auto_zero: true, gyro_bias: bias, ..Room::new(4) };
    let frames = room.frames(9.0, |time| {
        let s = smooth((time - 2.0) / 1.0);
        Isometry3::new(
            Vector3::new(0.4, 0.2, 0.0) * s,
            Vector3::new(0.02, 0.03, 0.25) * (s * (1.3 * (time - 2.0)).sin()),
        )
    });
    let pipeline = run(&frames);
    let found = Vector3::from(pipeline.trajectory().last().unwrap().gyro_bias);
    assert!((found - bias).norm() < 0.001, "{found:?}");
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.02 && degrees < 0.15, "{metres} m, {degrees} deg");
}

#[test]
fn a_tilted_rig_gets_a_map_whose_z_is_against_gravity() {
    let tilt = UnitQuaternion::from_euler_angles(0.17, -0.12, 0.0);
    let frames = Room::new(5).frames(8.0, |time| {
        let s = smooth((time - 2.0) / 5.0);
        Isometry3::from_parts(Translation3::new(1.5 * s, 0.5 * s, 0.0), tilt)
    });
    let pipeline = run(&frames);
    // The accelerometer's bias is a tilt of up to 0.2 degrees that nothing at rest can tell from gravity.
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.02 && degrees < 0.3, "{metres} m, {degrees} deg");
    let first = pipeline.trajectory()[3];
    assert_eq!(first.tracking_state(), Some(TrackingState::Initialising));
    assert_eq!(first.position, [0.0; 3]);
    assert!(map_from_lidar(&first).rotation.angle_to(&tilt).to_degrees() < 0.5);
}

#[test]
fn a_blank_wall_leaves_two_directions_unobserved_and_the_pose_says_which() {
    let room = Room { max: Vector3::new(1.2, 1.5, 1.8), ..Room::new(6) };
    let frames = room.frames(5.0, |_| Isometry3::identity());
    let pipeline = run(&frames);
    let pose = pipeline.trajectory().last().unwrap();
    assert_eq!((pose.degenerate, pose.tracking_state()), (2, Some(TrackingState::Degenerate)));
    for axis in &pose.degenerate_axes[..2] {
        let axis = Vector3::from(*axis);
        assert!((axis.norm() - 1.0).abs() < 1e-9 && axis.x.abs() < 0.05, "{axis:?}");
    }
    let [along, across, up] = [0, 7, 14].map(|i| pose.covariance[i].sqrt());
    assert!(across > 4.0 * along && up > 4.0 * along, "{along} {across} {up}");
    let (metres, _) = end_error(&pipeline, &frames);
    assert!(metres < 3.0 * position_sigma(pose), "{metres} m against {} m", position_sigma(pose));
}

#[test]
fn a_quarter_turn_to_a_blank_wall_and_back_holds_the_rotation() {
    let room = Room { min: Vector3::new(-3.0, -1.2, -1.2), max: Vector3::new(9.0, 1.2, 1.8), ..Room::new(7) };
    let frames = room.frames(12.0, |time| {
        let yaw = FRAC_PI_2 * (smooth((time - 3.0) / 2.0) - smooth((time - 7.0) / 2.0));
        Isometry3::new(Vector3::zeros(), Vector3::z() * yaw)
    });
    let pipeline = run(&frames);
    let facing = 65;
    assert!(pipeline.trajectory()[facing].degenerate >= 2);
    let (metres, degrees) = error_at(pipeline.trajectory(), &frames, facing);
    assert!(metres < 0.05 && degrees < 0.2, "facing the wall: {metres} m, {degrees} deg");
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.02 && degrees < 0.1, "back: {metres} m, {degrees} deg");
    assert_eq!(pipeline.trajectory().last().unwrap().degenerate, 0);
}

#[test]
fn scans_that_were_not_deskewed_are_followed_as_well() {
    let frames = Room::new(15).frames(8.0, glide(Vector3::new(1.5, 0.5, 0.0), 1.2, 4.0));
    let (poses, _, _) = odometry_alone(&frames);
    let (metres, degrees) = error_at(&poses, &frames, frames.len() - 1);
    assert!(metres < 0.015 && degrees < 0.15, "{metres} m, {degrees} deg");
}

#[test]
fn a_start_in_motion_is_made_after_a_while_with_larger_uncertainty() {
    let frames = Room { max: Vector3::new(20.0, 3.0, 1.8), ..Room::new(16) }.frames(12.0, |time| {
        let gait = Vector3::new(0.0, 0.02 * (11.0 * time).sin(), 0.02 * (9.0 * time).cos());
        Isometry3::new(
            Vector3::x() * (0.8 * time) + gait,
            Vector3::new(0.02, 0.01, 0.03) * (7.0 * time).sin(),
        )
    });
    let pipeline = run(&frames);
    assert!(!pipeline.odometry.diagnostics().started_standing);
    let first = pipeline.trajectory().iter().position(|pose| pose.state != 0).unwrap();
    assert!((30..60).contains(&first), "first pose at frame {first}");
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.15 && degrees < 1.0, "{metres} m, {degrees} deg");
}

#[test]
fn two_runs_over_the_same_data_are_equal_to_the_bit() {
    let frames =
        Room { people: 2, ..Room::new(17) }.frames(6.0, glide(Vector3::new(1.0, 0.3, 0.0), 0.8, 3.0));
    assert_eq!(run(&frames).trajectory(), run(&frames).trajectory());
}

#[test]
fn the_published_covariance_is_symmetric_and_positive() {
    let room =
        Room { min: Vector3::new(-3.0, -1.2, -1.2), max: Vector3::new(9.0, 1.2, 1.8), ..Room::new(18) };
    let frames = room.frames(8.0, glide(Vector3::new(0.5, 0.0, 0.0), FRAC_PI_2, 3.0));
    for pose in run(&frames).trajectory().iter().filter(|pose| pose.state != 0) {
        let covariance = Matrix6::from_row_slice(&pose.covariance);
        let smallest = covariance.symmetric_eigenvalues().min();
        assert!((covariance - covariance.transpose()).norm() < 1e-12);
        assert!(smallest > 0.0, "frame {}: {smallest}", pose.frame.seq);
    }
}

#[test]
fn a_full_map_gives_up_old_cells_and_goes_on() {
    let frames = Room { max: Vector3::new(14.0, 3.0, 1.8), ..Room::new(19) }
        .frames(12.0, glide(Vector3::new(8.0, 0.0, 0.0), 0.0, 9.0));
    let mut pipeline =
        Pipeline::<Lio>::with(LioConfig { max_cells: 4096, ..LioConfig::default() }, &Rig::default());
    for frame in &frames {
        frame.feed(&mut pipeline);
    }
    let diagnostics = pipeline.odometry.diagnostics();
    assert!(diagnostics.map_cells <= 4096 && diagnostics.evicted_cells > 0, "{diagnostics:?}");
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.08 && degrees < 0.3, "{metres} m, {degrees} deg");
}

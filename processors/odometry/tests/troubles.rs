//! What gaps, garbage and people before the sensor must not do to the odometry, in a box room whose truth is known.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic as the test may")]

mod common;

use std::f64::consts::FRAC_PI_2;

use common::room::{Frame, Room, glide, smooth};
use common::truth::{end_error, error_at, is_finite, odometry_alone, run};
use common::{Pipeline, position_sigma};
use evac_frames::{Point, TrackingState};
use evac_geometry::nalgebra::{Isometry3, Vector3};
use evac_odometry::LioConfig;
use evac_stage::Rig;

#[test]
fn a_gap_of_sixty_milliseconds_in_the_imu_is_bridged_and_counted() {
    let mut frames = Room::new(8).frames(8.0, glide(Vector3::new(1.5, 0.5, 0.0), 0.5, 5.0));
    for frame in &mut frames {
        frame.imu.retain(|sample| !(4_320_000_000..4_380_000_000).contains(&sample.stamp_ns));
    }
    let pipeline = run(&frames);
    assert_eq!(pipeline.odometry.diagnostics().imu_gaps, 1);
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.02 && degrees < 0.15, "{metres} m, {degrees} deg");
}

#[test]
fn a_walker_whose_imu_is_silent_for_half_a_second_before_a_blank_wall_is_within_what_is_said() {
    // Turns to a wall that shows neither height nor way along it, and bobs by 3 cm with each step: 0.4 m/s up and down.
    let room = Room::new(21);
    let walk = glide(Vector3::new(1.2, 0.0, 0.0), 0.0, 6.0);
    let mut frames = room.frames(9.0, |time| {
        let started = smooth(time - 2.0);
        let yaw = FRAC_PI_2 * (smooth((time - 4.0) / 1.5) - smooth((time - 7.0) / 1.5));
        let bob = 0.03 * (std::f64::consts::TAU * 1.9 * time).sin() * started;
        Isometry3::new(walk(time).translation.vector + Vector3::z() * bob, Vector3::z() * yaw)
    });
    for frame in &mut frames {
        frame.imu.retain(|sample| !(4_500_000_000..5_000_000_000).contains(&sample.stamp_ns));
    }
    let pipeline = run(&frames);
    let poses = pipeline.trajectory();
    for index in 20..frames.len() {
        let (metres, _) = error_at(poses, &frames, index);
        assert!(metres < 3.0 * position_sigma(&poses[index]) + 0.02, "frame {index}: {metres} m");
    }
    let (metres, degrees) = error_at(poses, &frames, 51);
    assert!(metres < 0.15 && degrees < 2.0, "after the gap: {metres} m, {degrees} deg");
}

#[test]
fn without_any_imu_for_half_a_second_the_match_alone_goes_on() {
    let mut frames = Room::new(9).frames(8.0, glide(Vector3::new(1.5, 0.5, 0.0), 0.3, 5.0));
    for frame in &mut frames {
        frame.imu.retain(|sample| !(4_300_000_000..4_800_000_000).contains(&sample.stamp_ns));
    }
    let (metres, degrees) = end_error(&run(&frames), &frames);
    assert!(metres < 0.06 && degrees < 0.3, "{metres} m, {degrees} deg");
}

#[test]
fn without_any_imu_the_match_alone_is_followed_after_the_time_out() {
    let mut frames = Room::new(24).frames(10.0, |time| {
        let s = smooth((time - 5.0) / 4.0);
        Isometry3::new(Vector3::new(1.0, 0.3, 0.0) * s, Vector3::z() * (0.2 * s))
    });
    frames.iter_mut().for_each(|frame| frame.imu.clear());
    let pipeline = run(&frames);
    assert!(pipeline.trajectory().iter().all(is_finite));
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.05 && degrees < 1.0, "{metres} m, {degrees} deg");
}

#[test]
fn a_second_without_lidar_costs_nothing() {
    let mut frames = Room::new(10).frames(8.0, glide(Vector3::new(1.5, 0.5, 0.0), 0.5, 5.0));
    // The IMU goes on: what it said meanwhile comes with the next scan.
    let lost: Vec<Frame> = frames.drain(40..50).collect();
    let mut imu: Vec<_> = lost.iter().flat_map(|frame| frame.imu.iter().copied()).collect();
    imu.append(&mut frames[40].imu);
    frames[40].imu = imu;
    let pipeline = run(&frames);
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.02 && degrees < 0.15, "{metres} m, {degrees} deg");
    assert_eq!(pipeline.odometry.diagnostics().losses, 0);
}

#[test]
fn a_walker_who_turns_back_during_a_second_without_lidar_is_found_where_he_is() {
    // To and fro, turning round within the second.
    let mut frames = Room::new(26).frames(7.0, |time| {
        let phase = (time - 2.0).clamp(0.0, 4.0) * std::f64::consts::FRAC_PI_2;
        Isometry3::translation(0.8 * (1.0 - phase.cos()), 0.0, 0.0)
    });
    let lost: Vec<Frame> = frames.drain(35..45).collect();
    let mut imu: Vec<_> = lost.iter().flat_map(|frame| frame.imu.iter().copied()).collect();
    imu.append(&mut frames[35].imu);
    frames[35].imu = imu;
    let pipeline = run(&frames);
    let poses = pipeline.trajectory();
    let (metres, _) = error_at(poses, &frames, 35);
    assert!(metres < 0.05 && poses[35].state != TrackingState::Lost as u32, "{metres} m");
}

#[test]
fn empty_scans_are_dead_reckoned_and_said_to_observe_nothing() {
    let mut frames = Room::new(11).frames(8.0, glide(Vector3::new(1.5, 0.5, 0.0), 0.5, 5.0));
    for frame in &mut frames[40..45] {
        frame.points.clear();
    }
    let pipeline = run(&frames);
    assert!(pipeline.trajectory()[40..45].iter().all(|pose| pose.degenerate == 3 && pose.quality == 0.0));
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.02 && degrees < 0.15, "{metres} m, {degrees} deg");
}

#[test]
fn an_imu_that_lies_makes_a_loss_which_is_said_and_mended() {
    let mut frames = Room::new(12).frames(10.0, glide(Vector3::new(1.0, 0.5, 0.0), 0.3, 7.0));
    for sample in frames[40..44].iter_mut().flat_map(|frame| frame.imu.iter_mut()) {
        sample.accel[1] += 60.0;
        sample.gyro[2] += 0.3;
    }
    let pipeline = run(&frames);
    let states: Vec<_> = pipeline.trajectory().iter().map(|pose| pose.tracking_state().unwrap()).collect();
    assert!(states.contains(&TrackingState::Lost));
    assert_eq!(states.last(), Some(&TrackingState::Tracking));
    assert!(pipeline.odometry.diagnostics().losses >= 1);
    let lost = states.iter().filter(|state| **state == TrackingState::Lost).count();
    assert_eq!(pipeline.counters.degraded, lost as u64);
    let limit = LioConfig::default().max_speed_m_s;
    for pose in pipeline.trajectory() {
        assert!(is_finite(pose) && Vector3::from(pose.velocity).norm() <= limit);
    }
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.05 && degrees < 0.5, "{metres} m, {degrees} deg");
}

#[test]
fn people_who_walk_through_the_view_do_not_take_the_pose_along() {
    let frames =
        Room { people: 3, ..Room::new(13) }.frames(10.0, glide(Vector3::new(0.0, 0.8, 0.0), 0.3, 6.0));
    let pipeline = run(&frames);
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.03 && degrees < 0.2, "{metres} m, {degrees} deg");
    assert_eq!(pipeline.odometry.diagnostics().losses, 0);
}

#[test]
fn values_that_are_not_finite_are_dropped_counted_and_never_published() {
    let mut frames = Room::new(14).frames(6.0, glide(Vector3::new(1.0, 0.0, 0.0), 0.0, 3.0));
    for frame in &mut frames {
        for point in frame.points.iter_mut().step_by(50) {
            *point = point.moved_to(f32::NAN, f32::INFINITY, 1.0);
        }
        frame.imu[7].gyro[1] = f64::NAN;
        frame.imu[11].accel[0] = f64::INFINITY;
    }
    // Straight into the odometry: the deskewer would drop them first.
    let (poses, counters, lio) = odometry_alone(&frames);
    assert!(poses.iter().all(is_finite));
    assert_eq!(counters.rejected, 200 * frames.len() as u64);
    assert_eq!(lio.diagnostics().imu_rejected, 2 * frames.len() as u64);
    let (metres, degrees) = error_at(&poses, &frames, frames.len() - 1);
    assert!(metres < 0.02 && degrees < 0.2, "{metres} m, {degrees} deg");
}

#[test]
fn a_frame_from_the_past_changes_nothing_and_counts_as_late() {
    let frames = Room::new(20).frames(6.0, glide(Vector3::new(1.0, 0.0, 0.0), 0.0, 3.0));
    let mut pipeline = Pipeline::new(&Rig::default());
    for frame in &frames {
        frame.feed(&mut pipeline);
        if frame.header.frame.seq == 40 {
            frames[38].feed(&mut pipeline);
        }
    }
    assert_eq!(pipeline.counters.late, 1);
    let (metres, _) = end_error(&pipeline, &frames);
    assert!(metres < 0.02, "{metres} m");
}

#[test]
fn a_step_of_the_sensor_clock_is_survived() {
    let mut frames = Room::new(21).frames(9.0, glide(Vector3::new(1.0, 0.0, 0.0), 0.0, 5.0));
    let step = 3_600_000_000_000;
    for frame in &mut frames[45..] {
        frame.header.frame.start_ns += step;
        frame.header.frame.end_ns += step;
        frame.imu.iter_mut().for_each(|sample| sample.stamp_ns += step);
    }
    let pipeline = run(&frames);
    assert!(pipeline.trajectory().iter().all(is_finite));
    let (metres, degrees) = end_error(&pipeline, &frames);
    assert!(metres < 0.05 && degrees < 0.5, "{metres} m, {degrees} deg");
}

#[test]
fn a_scan_of_garbage_is_no_reason_to_publish_garbage() {
    let mut frames = Room::new(22).frames(6.0, glide(Vector3::new(1.0, 0.0, 0.0), 0.0, 3.0));
    for (i, point) in frames[40].points.iter_mut().enumerate() {
        let i = i as f32;
        *point = Point::new((i * 0.37).sin() * 40.0, (i * 0.73).cos() * 40.0, i * 0.01 - 50.0, 0, 0);
    }
    let (metres, degrees) = end_error(&run(&frames), &frames);
    assert!(metres < 0.03 && degrees < 0.2, "{metres} m, {degrees} deg");
}

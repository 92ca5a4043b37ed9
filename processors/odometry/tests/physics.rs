//! What the odometry must do in a box room whose truth is known.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic as the test may")]

mod common;

use std::f64::consts::FRAC_PI_2;

use common::room::{Frame, Room, glide, smooth};
use common::{Pipeline, position_sigma};
use evac_frames::{Point, PoseFrame, TrackingState};
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3};
use evac_odometry::{Lio, LioConfig};
use evac_stage::{Counters, PoseOutput, Rig, ScanWithImu, Stage};

fn run(frames: &[Frame]) -> Pipeline {
    let mut pipeline = Pipeline::new(&Rig::default());
    for frame in frames {
        frame.feed(&mut pipeline);
    }
    pipeline
}

/// Errors of position (metres) and rotation (degrees) of a pose relative to the first that was tracked: the tilt that an
/// accelerometer's bias looks like at rest is the map's and stays.
fn error_at(poses: &[PoseFrame], frames: &[Frame], index: usize) -> (f64, f64) {
    let first = poses.iter().position(|pose| pose.state != TrackingState::Initialising as u32).unwrap();
    let estimated = map_from_lidar(&poses[first]).inverse() * map_from_lidar(&poses[index]);
    let difference = (frames[first].truth.inverse() * frames[index].truth).inverse() * estimated;
    (difference.translation.vector.norm(), difference.rotation.angle().to_degrees())
}

fn end_error(pipeline: &Pipeline, frames: &[Frame]) -> (f64, f64) {
    error_at(pipeline.trajectory(), frames, frames.len() - 1)
}

fn is_finite(pose: &PoseFrame) -> bool {
    let vectors =
        [pose.position, pose.imu_position, pose.velocity, pose.gyro_bias, pose.accel_bias, pose.gravity];
    vectors.iter().flatten().chain(&pose.orientation).chain(&pose.imu_orientation).all(|x| x.is_finite())
        && pose.covariance.iter().chain(pose.degenerate_axes.iter().flatten()).all(|x| x.is_finite())
        && pose.quality.is_finite()
}

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
fn scans_that_were_not_deskewed_are_followed_as_well() {
    let frames = Room::new(15).frames(8.0, glide(Vector3::new(1.5, 0.5, 0.0), 1.2, 4.0));
    let (poses, _, _) = odometry_alone(&frames);
    let (metres, degrees) = error_at(&poses, &frames, frames.len() - 1);
    assert!(metres < 0.015 && degrees < 0.15, "{metres} m, {degrees} deg");
}

fn odometry_alone(frames: &[Frame]) -> (Vec<PoseFrame>, Counters, Lio) {
    let mut lio = Lio::new(LioConfig::default(), &Rig::default()).unwrap();
    let (mut output, mut counters) = (PoseOutput::default(), Counters::default());
    for frame in frames {
        let input = ScanWithImu {
            header: &frame.header,
            points: &frame.points,
            imu: &frame.imu,
            imu_covers: true,
            prior: None,
        };
        lio.process(input, &mut output, &mut counters).unwrap();
    }
    (output.memory, counters, lio)
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

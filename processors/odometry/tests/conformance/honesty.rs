//! What must be said: a start in motion, directions that nothing observes, uncertainty, loss.

use std::f64::consts::FRAC_PI_2;

use evac_frames::TrackingState;
use evac_geometry::nalgebra::{Isometry3, Matrix6, UnitQuaternion, Vector3};

use super::common::position_sigma;
use super::common::room::{Room, glide, smooth};
use super::{Limits, Odometry, assert_end, assert_sound, error_at, run};

pub(super) fn a_start_in_motion_is_said_and_less_certain_than_one_from_rest<S: Odometry>(limits: &Limits) {
    let room = Room { max: Vector3::new(20.0, 3.0, 1.8), ..Room::new(16) };
    let moving = room.frames(12.0, |time| {
        let gait = Vector3::new(0.0, 0.02 * (11.0 * time).sin(), 0.02 * (9.0 * time).cos());
        Isometry3::new(
            Vector3::x() * (0.8 * time) + gait,
            Vector3::new(0.02, 0.01, 0.03) * (7.0 * time).sin(),
        )
    });
    let resting = room.frames(8.0, glide(Vector3::new(2.0, 0.0, 0.0), 0.0, 5.0));
    let first = |poses: &[evac_frames::PoseFrame]| poses.iter().position(|pose| pose.state != 0).unwrap();
    let (moved, rested) = (run::<S>(&moving), run::<S>(&resting));
    let (late, soon) = (first(moved.trajectory()), first(rested.trajectory()));
    assert!(late > soon && late < 60, "first poses at frames {late} and {soon}");
    assert!(position_sigma(&moved.trajectory()[late]) > position_sigma(&rested.trajectory()[soon]));
    assert_end(&moved, &moving, limits.poor);
}

pub(super) fn a_blank_wall_leaves_two_directions_unobserved_and_the_pose_says_which<S: Odometry>(_: &Limits) {
    let room = Room { max: Vector3::new(1.2, 1.5, 1.8), ..Room::new(6) };
    let frames = room.frames(5.0, |_| Isometry3::identity());
    let pipeline = run::<S>(&frames);
    let pose = pipeline.trajectory().last().unwrap();
    assert_eq!((pose.degenerate, pose.tracking_state()), (2, Some(TrackingState::Degenerate)));
    for axis in &pose.degenerate_axes[..2] {
        let axis = Vector3::from(*axis);
        assert!((axis.norm() - 1.0).abs() < 1e-9 && axis.x.abs() < 0.05, "{axis:?}");
    }
    let [along, across, up] = [0, 7, 14].map(|i| pose.covariance[i].sqrt());
    assert!(across > 1.5 * along && up > 1.5 * along, "{along} {across} {up}");
    let (metres, _) = error_at(pipeline.trajectory(), &frames, frames.len() - 1);
    assert!(metres < 3.0 * position_sigma(pose), "{metres} m against {} m", position_sigma(pose));
}

pub(super) fn a_turn_to_a_blank_wall_and_back_is_survived_and_named<S: Odometry>(limits: &Limits) {
    let room = Room { min: Vector3::new(-3.0, -1.2, -1.2), max: Vector3::new(9.0, 1.2, 1.8), ..Room::new(7) };
    let frames = room.frames(12.0, |time| {
        let yaw = FRAC_PI_2 * (smooth((time - 3.0) / 2.0) - smooth((time - 7.0) / 2.0));
        Isometry3::new(Vector3::zeros(), Vector3::z() * yaw)
    });
    let pipeline = run::<S>(&frames);
    assert_sound(pipeline.trajectory());
    let facing = 65;
    assert!(pipeline.trajectory()[facing].degenerate >= 2);
    let (metres, degrees) = error_at(pipeline.trajectory(), &frames, facing);
    assert!(metres < 0.1 && degrees < limits.walk.1, "facing the wall: {metres} m, {degrees} deg");
    assert!(metres < 3.0 * position_sigma(&pipeline.trajectory()[facing]));
    assert_end(&pipeline, &frames, limits.fault);
    assert_eq!(pipeline.trajectory().last().unwrap().degenerate, 0);
}

pub(super) fn the_published_covariance_is_symmetric_and_positive<S: Odometry>(_: &Limits) {
    let room =
        Room { min: Vector3::new(-3.0, -1.2, -1.2), max: Vector3::new(9.0, 1.2, 1.8), ..Room::new(18) };
    let frames = room.frames(8.0, glide(Vector3::new(0.5, 0.0, 0.0), FRAC_PI_2, 3.0));
    for pose in run::<S>(&frames).trajectory().iter().filter(|pose| pose.state != 0) {
        let covariance = Matrix6::from_row_slice(&pose.covariance);
        let smallest = covariance.symmetric_eigenvalues().min();
        assert!((covariance - covariance.transpose()).norm() < 1e-12);
        assert!(smallest > 0.0, "frame {}: {smallest}", pose.frame.seq);
    }
}

/// For a second the scans are those of a LiDAR that was knocked round by 35 degrees, which the IMU knows nothing of.
pub(super) fn a_loss_is_said_and_mended<S: Odometry>(limits: &Limits) {
    let mut frames = Room::new(12).frames(11.0, glide(Vector3::new(1.0, 0.5, 0.0), 0.3, 7.0));
    let knock = UnitQuaternion::from_euler_angles(0.0, 0.3, 0.6);
    for point in frames[45..55].iter_mut().flat_map(|frame| frame.points.iter_mut()) {
        let knocked = knock * Vector3::new(point.x, point.y, point.z).cast::<f64>();
        *point = point.moved_to(knocked.x as f32, knocked.y as f32, knocked.z as f32);
    }
    let pipeline = run::<S>(&frames);
    assert_sound(pipeline.trajectory());
    let states: Vec<_> = pipeline.trajectory().iter().map(|pose| pose.tracking_state().unwrap()).collect();
    assert!(states[45..60].contains(&TrackingState::Lost) && pipeline.odometry.losses() >= 1);
    assert_eq!(states.last(), Some(&TrackingState::Tracking), "{}", pipeline.odometry.said());
    let lost = states.iter().filter(|state| **state == TrackingState::Lost).count();
    assert_eq!(pipeline.counters.degraded, lost as u64);
    assert_end(&pipeline, &frames, limits.fault);
}

//! What every odometry must do, whatever its method: one body per sentence, run for each of them.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic as the test may")]

#[path = "../common/mod.rs"]
mod common;
mod faults;
mod honesty;
mod motions;

use common::room::Frame;
use common::{Odometry, Pipeline};
use evac_frames::{PoseFrame, TrackingState};
use evac_geometry::map_from_lidar;
use evac_odometry::{Lio, Loam};
use evac_stage::Rig;

/// No two poses in a row are farther apart than this, metres: a walker makes 0.15 m in a frame.
const JUMP: f64 = 0.3;

/// What an odometry may be wrong by.
#[derive(Clone, Copy)]
struct Limits {
    /// At the end of a short walk in a room where all is observed, metres and degrees.
    walk: (f64, f64),
    /// After half a minute before a blank wall without motion.
    wall: (f64, f64),
    /// After a walk with a fault in it that was said and mended.
    fault: (f64, f64),
    /// After a walk that began in motion, or had no IMU.
    poor: (f64, f64),
}

const LIO: Limits = Limits { walk: (0.02, 0.2), wall: (0.02, 0.3), fault: (0.06, 0.5), poor: (0.15, 1.0) };
const LOAM: Limits = Limits { walk: (0.04, 0.5), wall: (0.05, 0.5), fault: (0.15, 1.0), poor: (0.25, 2.0) };

macro_rules! conformance {
    ($($part:ident :: $sentence:ident),+ $(,)?) => {
        mod lio {
            $(#[test] fn $sentence() { super::$part::$sentence::<super::Lio>(&super::LIO); })+
        }
        mod loam {
            $(#[test] fn $sentence() { super::$part::$sentence::<super::Loam>(&super::LOAM); })+
        }
    };
}

conformance! {
    motions::every_scan_gives_one_pose_with_its_own_header,
    motions::a_walk_through_a_room_is_followed_without_a_jump,
    motions::a_standing_rig_does_not_drift_though_its_gyroscope_reads_zeros,
    motions::a_rig_that_stands_before_a_blank_wall_does_not_glide_along_it,
    motions::people_who_walk_through_the_view_do_not_take_the_pose_along,
    motions::two_runs_over_the_same_data_are_equal_to_the_byte,
    motions::stamps_since_boot_and_since_1970_make_the_same_trajectory,
    motions::without_any_imu_the_match_alone_is_followed,
    honesty::a_start_in_motion_is_said_and_less_certain_than_one_from_rest,
    honesty::a_blank_wall_leaves_two_directions_unobserved_and_the_pose_says_which,
    honesty::a_turn_to_a_blank_wall_and_back_is_survived_and_named,
    honesty::the_published_covariance_is_symmetric_and_positive,
    honesty::a_loss_is_said_and_mended,
    faults::values_that_are_not_finite_are_dropped_counted_and_never_published,
    faults::a_frame_from_the_past_changes_nothing_and_counts_as_late,
    faults::scans_of_garbage_make_neither_garbage_nor_a_jump,
    faults::empty_scans_are_dead_reckoned_and_said_to_observe_nothing,
    faults::a_step_of_the_sensor_clock_is_survived,
}

fn run<S: Odometry>(frames: &[Frame]) -> Pipeline<S> {
    let mut pipeline = Pipeline::with(S::Config::default(), &Rig::default());
    for frame in frames {
        frame.feed(&mut pipeline);
    }
    pipeline
}

/// Errors of position (metres) and rotation (degrees) at `index` relative to the first pose that was tracked.
fn error_at(poses: &[PoseFrame], frames: &[Frame], index: usize) -> (f64, f64) {
    let first = poses.iter().position(|pose| pose.state != TrackingState::Initialising as u32).unwrap();
    let estimated = map_from_lidar(&poses[first]).inverse() * map_from_lidar(&poses[index]);
    let difference = (frames[first].truth.inverse() * frames[index].truth).inverse() * estimated;
    (difference.translation.vector.norm(), difference.rotation.angle().to_degrees())
}

fn assert_end<S: Odometry>(pipeline: &Pipeline<S>, frames: &[Frame], limit: (f64, f64)) {
    let (metres, degrees) = error_at(pipeline.trajectory(), frames, frames.len() - 1);
    assert!(
        metres < limit.0 && degrees < limit.1,
        "{metres} m, {degrees} deg at the end; {}",
        pipeline.odometry.said()
    );
}

fn assert_sound(poses: &[PoseFrame]) {
    for pose in poses {
        assert!(is_finite(pose) && pose.tracking_state().is_some(), "{pose:?}");
        assert!((0.0..=1.0).contains(&pose.quality) && pose.degenerate <= 3, "{pose:?}");
    }
    for pair in poses.windows(2) {
        let step = map_from_lidar(&pair[0]).translation.vector - map_from_lidar(&pair[1]).translation.vector;
        assert!(step.norm() < JUMP, "{} m at frame {}", step.norm(), pair[1].frame.seq);
    }
}

fn is_finite(pose: &PoseFrame) -> bool {
    let vectors =
        [pose.position, pose.imu_position, pose.velocity, pose.gyro_bias, pose.accel_bias, pose.gravity];
    vectors.iter().flatten().chain(&pose.orientation).chain(&pose.imu_orientation).all(|x| x.is_finite())
        && pose.covariance.iter().chain(pose.degenerate_axes.iter().flatten()).all(|x| x.is_finite())
        && pose.quality.is_finite()
}

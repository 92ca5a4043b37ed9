//! Motions that must be followed.

use evac_geometry::nalgebra::{Isometry3, Vector3};

use super::common::room::{Frame, Room, glide, smooth};
use super::{Limits, Odometry, assert_end, assert_sound, run};

pub(super) fn every_scan_gives_one_pose_with_its_own_header<S: Odometry>(_: &Limits) {
    let frames = Room::new(2).frames(3.0, glide(Vector3::new(0.3, 0.0, 0.0), 0.0, 1.0));
    let pipeline = run::<S>(&frames);
    assert_eq!(pipeline.trajectory().len(), frames.len());
    for (pose, frame) in pipeline.trajectory().iter().zip(&frames) {
        assert_eq!(pose.frame, frame.header.frame);
    }
}

pub(super) fn a_walk_through_a_room_is_followed_without_a_jump<S: Odometry>(limits: &Limits) {
    let room = Room { max: Vector3::new(12.0, 1.5, 1.8), ..Room::new(1) };
    // 1.1 m/s in the middle of the way.
    let frames = room.frames(9.0, glide(Vector3::new(3.0, -0.6, 0.1), 0.2, 6.0));
    let pipeline = run::<S>(&frames);
    assert_sound(pipeline.trajectory());
    assert_end(&pipeline, &frames, limits.walk);
    assert_eq!(pipeline.odometry.losses(), 0);
}

pub(super) fn a_standing_rig_does_not_drift_though_its_gyroscope_reads_zeros<S: Odometry>(limits: &Limits) {
    for auto_zero in [false, true] {
        let frames = Room { auto_zero, ..Room::new(3) }.frames(20.0, |_| Isometry3::identity());
        let pipeline = run::<S>(&frames);
        assert_end(&pipeline, &frames, (limits.walk.0 / 4.0, limits.walk.1 / 4.0));
    }
}

pub(super) fn a_rig_that_stands_before_a_blank_wall_does_not_glide_along_it<S: Odometry>(limits: &Limits) {
    for auto_zero in [false, true] {
        let room = Room { max: Vector3::new(1.2, 1.5, 1.8), auto_zero, ..Room::new(23) };
        let frames = room.frames(30.0, |_| Isometry3::identity());
        assert_end(&run::<S>(&frames), &frames, limits.wall);
    }
}

pub(super) fn people_who_walk_through_the_view_do_not_take_the_pose_along<S: Odometry>(limits: &Limits) {
    let room = Room { people: 3, ..Room::new(13) };
    let frames = room.frames(10.0, glide(Vector3::new(0.0, 0.8, 0.0), 0.3, 6.0));
    let pipeline = run::<S>(&frames);
    assert_sound(pipeline.trajectory());
    assert_end(&pipeline, &frames, limits.fault);
    assert_eq!(pipeline.odometry.losses(), 0);
}

pub(super) fn two_runs_over_the_same_data_are_equal_to_the_byte<S: Odometry>(_: &Limits) {
    let frames =
        Room { people: 2, ..Room::new(17) }.frames(6.0, glide(Vector3::new(1.0, 0.3, 0.0), 0.8, 3.0));
    let [first, second] = [(); 2].map(|()| run::<S>(&frames));
    let bytes = |poses| bytemuck::cast_slice::<_, u8>(poses).to_vec();
    assert!(bytes(first.trajectory()) == bytes(second.trajectory()));
}

pub(super) fn stamps_since_boot_and_since_1970_make_the_same_trajectory<S: Odometry>(_: &Limits) {
    let boot = Room::new(19).frames(6.0, glide(Vector3::new(1.0, 0.3, 0.0), 0.5, 3.0));
    let mut epoch = boot.clone();
    shift(&mut epoch, 1_732_000_000_123_456_789);
    let (boot, epoch) = (run::<S>(&boot), run::<S>(&epoch));
    for (a, b) in boot.trajectory().iter().zip(epoch.trajectory()) {
        assert_eq!((a.position, a.orientation, a.covariance), (b.position, b.orientation, b.covariance));
    }
}

pub(super) fn without_any_imu_the_match_alone_is_followed<S: Odometry>(limits: &Limits) {
    let mut frames = Room::new(24).frames(10.0, |time| {
        let s = smooth((time - 5.0) / 4.0);
        Isometry3::new(Vector3::new(1.0, 0.3, 0.0) * s, Vector3::z() * (0.2 * s))
    });
    frames.iter_mut().for_each(|frame| frame.imu.clear());
    let pipeline = run::<S>(&frames);
    assert_sound(pipeline.trajectory());
    assert_end(&pipeline, &frames, limits.poor);
}

/// Moves all stamps.
pub(super) fn shift(frames: &mut [Frame], by_ns: i64) {
    for frame in frames {
        frame.header.frame.start_ns += by_ns;
        frame.header.frame.end_ns += by_ns;
        frame.imu.iter_mut().for_each(|sample| sample.stamp_ns += by_ns);
    }
}

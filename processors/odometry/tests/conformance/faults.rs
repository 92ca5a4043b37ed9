//! Faults of the data that must do no harm.

use evac_frames::Point;
use evac_geometry::nalgebra::Vector3;
use evac_stage::{Counters, PoseOutput, Rig};

use super::common::room::{Room, glide};
use super::motions::shift;
use super::{Limits, Odometry, Pipeline, assert_end, assert_sound, run};

pub(super) fn values_that_are_not_finite_are_dropped_counted_and_never_published<S: Odometry>(_: &Limits) {
    let mut frames = Room::new(14).frames(6.0, glide(Vector3::new(1.0, 0.0, 0.0), 0.0, 3.0));
    let mut odometry = S::new(S::Config::default(), &Rig::default()).unwrap();
    let (mut output, mut counters) = (PoseOutput::default(), Counters::default());
    for frame in &mut frames {
        for point in frame.points.iter_mut().step_by(50) {
            *point = point.moved_to(f32::NAN, f32::INFINITY, 1.0);
        }
        frame.imu[7].gyro[1] = f64::NAN;
        frame.imu[11].accel[0] = f64::INFINITY;
        frame.header.scan_flags |= evac_frames::scan_flags::DESKEWED;
        // Straight into the odometry: the deskewer would drop them first.
        odometry.process(frame.input(), &mut output, &mut counters).unwrap();
    }
    assert_sound(&output.memory);
    assert_eq!(counters.rejected, 200 * frames.len() as u64);
    assert!(output.memory.last().unwrap().position[0] > 0.9, "{:?}", output.memory.last());
}

pub(super) fn a_frame_from_the_past_changes_nothing_and_counts_as_late<S: Odometry>(_: &Limits) {
    let frames = Room::new(20).frames(6.0, glide(Vector3::new(1.0, 0.0, 0.0), 0.0, 3.0));
    let clean = run::<S>(&frames);
    let mut pipeline = Pipeline::<S>::with(S::Config::default(), &Rig::default());
    for frame in &frames {
        frame.feed(&mut pipeline);
        if frame.header.frame.seq == 40 {
            frames[38].feed(&mut pipeline);
        }
    }
    assert_eq!(pipeline.counters.late, 1);
    let (poses, clean) = (pipeline.trajectory(), clean.trajectory());
    assert_eq!(poses[41].frame.seq, 38);
    assert_eq!(poses[41].position, poses[40].position);
    // The deskewer's prior was that pose for one frame, so that later ones may differ by a little.
    let apart = Vector3::from(poses.last().unwrap().position) - Vector3::from(clean.last().unwrap().position);
    assert!(apart.norm() < 0.01, "{apart:?}");
}

pub(super) fn scans_of_garbage_make_neither_garbage_nor_a_jump<S: Odometry>(limits: &Limits) {
    let mut frames = Room::new(22).frames(8.0, glide(Vector3::new(1.0, 0.0, 0.0), 0.0, 4.0));
    for frame in &mut frames[40..43] {
        for (i, point) in frame.points.iter_mut().enumerate() {
            let i = i as f32;
            *point = Point::new((i * 0.37).sin() * 40.0, (i * 0.73).cos() * 40.0, i * 0.01 - 50.0, 0, 0);
        }
    }
    let pipeline = run::<S>(&frames);
    assert_sound(pipeline.trajectory());
    assert_end(&pipeline, &frames, limits.fault);
}

pub(super) fn empty_scans_are_dead_reckoned_and_said_to_observe_nothing<S: Odometry>(limits: &Limits) {
    let mut frames = Room::new(11).frames(8.0, glide(Vector3::new(1.5, 0.5, 0.0), 0.2, 5.0));
    for frame in &mut frames[40..45] {
        frame.points.clear();
    }
    let pipeline = run::<S>(&frames);
    assert_sound(pipeline.trajectory());
    assert!(pipeline.trajectory()[40..45].iter().all(|pose| pose.degenerate == 3 && pose.quality == 0.0));
    assert_end(&pipeline, &frames, limits.fault);
}

pub(super) fn a_step_of_the_sensor_clock_is_survived<S: Odometry>(limits: &Limits) {
    let mut frames = Room::new(21).frames(9.0, glide(Vector3::new(1.0, 0.0, 0.0), 0.0, 5.0));
    shift(&mut frames[45..], 3_600_000_000_000);
    let pipeline = run::<S>(&frames);
    assert_sound(pipeline.trajectory());
    assert_end(&pipeline, &frames, limits.fault);
}

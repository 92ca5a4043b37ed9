//! What deskewing does to a scan, on motions and walls known in closed form.
#![allow(clippy::unwrap_used)] // helpers of tests

mod synthetic;

use evac_deskewer::{Deskewer, DeskewerConfig};
use evac_frames::{ImuSample, Point, PoseFrame, ScanHeader, TrackingState, scan_flags};
use evac_geometry::nalgebra::Vector3;
use evac_stage::{Counters, ScanOutput, ScanWithImu, Stage};
use synthetic::{FRAME_NS, Motion, POINTS, Recording};

const MILLIMETRE: f64 = 1e-3;

fn stage(motion: &Motion) -> Deskewer {
    Deskewer::new(DeskewerConfig::default(), &motion.rig).unwrap()
}

fn run(stage: &mut Deskewer, input: ScanWithImu<'_>) -> (ScanHeader, Vec<Point>, Counters) {
    let (mut output, mut counters) = (ScanOutput::default(), Counters::default());
    stage.process(input, &mut output, &mut counters).unwrap();
    let (header, points) = output.memory.pop().unwrap();
    assert!(output.memory.is_empty());
    assert_eq!(header.points as usize, points.len());
    (header, points, counters)
}

/// Error in the frame's end pose before and after deskewing.
fn errors(motion: &Motion, recording: &Recording, points: &[Point]) -> (f64, f64) {
    let end_ns = recording.header.frame.end_ns;
    (motion.worst_error(recording, &recording.points, end_ns), motion.worst_error(recording, points, end_ns))
}

/// Feeds frames 0 to `last` without any pose and gives the last frame's errors.
fn alone(motion: &Motion, last: u64, change: impl Fn(&mut ImuSample)) -> (f64, f64) {
    let mut stage = stage(motion);
    let mut result = None;
    for seq in 0..=last {
        let mut recording = motion.scan(seq);
        recording.imu.iter_mut().for_each(&change);
        let (header, points, _) = run(&mut stage, recording.input_without_prior());
        assert_eq!(header.scan_flags, scan_flags::DESKEWED);
        result = Some(errors(motion, &recording, &points));
    }
    result.unwrap()
}

#[test]
fn at_130_deg_per_s_and_1_5_m_per_s_walls_30_m_away_come_out_flat_to_a_millimetre() {
    let motion = Motion::walking();
    for seq in [16, 20, 25, 31] {
        let recording = motion.scan(seq);
        let (header, points, counters) = run(&mut stage(&motion), recording.input());
        let (before, after) = errors(&motion, &recording, &points);
        assert!(before > 0.2, "frame {seq}: {before} m of smear");
        assert!(after < MILLIMETRE, "frame {seq}: {before} -> {after} m");
        assert_eq!(header.scan_flags, scan_flags::DESKEWED);
        assert_eq!((header.rejected, header.no_return, counters), (0, 0, Counters::default()));
    }
}

#[test]
fn switched_off_it_passes_scans_as_they_came_and_complains_of_nothing() {
    let motion = Motion::walking();
    let recording = motion.scan(20);
    let mut stage =
        Deskewer::new(DeskewerConfig { enabled: false, ..DeskewerConfig::default() }, &motion.rig).unwrap();
    let (header, points, counters) = run(&mut stage, recording.input());
    assert_eq!((header.scan_flags, points, counters), (0, recording.points, Counters::default()));
}

#[test]
fn a_steady_turn_alone_is_undone_to_less_than_a_millimetre_at_30_metres() {
    let motion = Motion::turning();
    let recording = motion.scan(25);
    let (_, points, _) = run(&mut stage(&motion), recording.input());
    let (before, after) = errors(&motion, &recording, &points);
    assert!(before > 1.0 && after < MILLIMETRE, "{before} -> {after} m");
}

#[test]
fn without_a_pose_a_turn_after_a_standstill_is_undone_lever_arm_and_gyroscope_bias_included() {
    let motion = Motion::turning();
    let bias = Vector3::new(0.005, -0.012, 0.009);
    let (before, after) = alone(&motion, 22, |sample| {
        sample.gyro = (Vector3::from(sample.gyro) + bias).into();
    });
    assert!(before > 1.0 && after < 2.0 * MILLIMETRE, "{before} -> {after} m");
}

#[test]
fn from_the_first_frame_on_the_bias_of_a_resting_gyroscope_does_not_bend_the_walls() {
    let motion = Motion::turning();
    for last in [0, 1, 5] {
        let (_, after) = alone(&motion, last, |sample| {
            sample.gyro = (Vector3::from(sample.gyro) + Vector3::new(0.005, -0.012, 0.009)).into();
        });
        assert!(after < MILLIMETRE, "frame {last}: {after} m");
    }
}

#[test]
fn without_a_pose_the_velocity_gained_since_the_standstill_is_used_and_then_forgotten() {
    let motion = Motion { turn_rate: 0.0, velocity: Vector3::new(0.0, 1.5, 0.0), ..Motion::turning() };
    // 0.5 s after the start of the motion most of the velocity is known; long after it nothing, as a steady straight
    // motion without any shake cannot be told from rest.
    let (before, soon) = alone(&motion, 19, |_| {});
    let (_, late) = alone(&motion, 70, |_| {});
    assert!(before > 0.1, "{before}");
    assert!(soon < 0.3 * before, "{before} -> {soon}");
    assert!((0.9 * before..1.1 * before).contains(&late), "{before} -> {late}");
}

#[test]
fn without_pose_or_standstill_the_rotation_is_still_undone() {
    let motion = Motion { starts_s: -1.0, ..Motion::turning() };
    let (before, after) = alone(&motion, 3, |_| {});
    assert!(before > 1.0 && after < 10.0 * MILLIMETRE, "{before} -> {after} m");
}

#[test]
fn a_gyroscope_held_at_zero_by_its_firmware_gives_no_bias_to_subtract() {
    let motion = Motion::turning();
    let hold = |sample: &mut ImuSample| {
        // A true bias that the firmware removes: what it puts out is right in motion and exactly zero at rest.
        if Vector3::from(sample.gyro).norm() < 0.01 {
            sample.gyro = [0.0; 3];
        }
    };
    let (before, after) = alone(&motion, 22, hold);
    assert!(before > 1.0 && after < 2.0 * MILLIMETRE, "{before} -> {after} m");
}

#[test]
fn biases_of_the_pose_are_subtracted() {
    let motion = Motion::walking();
    let mut recording = motion.scan(25);
    let (gyro_bias, accel_bias) = (Vector3::new(0.02, -0.03, 0.01), Vector3::new(0.2, -0.3, 0.25));
    for sample in &mut recording.imu {
        sample.gyro = (Vector3::from(sample.gyro) + gyro_bias).into();
        sample.accel = (Vector3::from(sample.accel) + accel_bias).into();
    }
    let (_, biased, _) = run(&mut stage(&motion), recording.input());
    recording.prior.gyro_bias = gyro_bias.into();
    recording.prior.accel_bias = accel_bias.into();
    let (_, corrected, _) = run(&mut stage(&motion), recording.input());
    assert!(errors(&motion, &recording, &biased).1 > 0.02);
    assert!(errors(&motion, &recording, &corrected).1 < 2.0 * MILLIMETRE);
}

#[test]
fn the_time_offset_of_the_pose_is_added_to_the_stamps_of_the_imu() {
    // The turn speeds up within the frame, so that 8 ms matter.
    let motion = Motion::walking();
    let mut recording = motion.scan(16);
    recording.imu =
        motion.imu(recording.header.frame.start_ns - 20_000_000, recording.header.frame.end_ns + 20_000_000);
    recording.imu.iter_mut().for_each(|sample| sample.stamp_ns -= 8_000_000);
    let (_, late, _) = run(&mut stage(&motion), recording.input());
    recording.prior.time_offset_ns = 8_000_000;
    let (_, aligned, _) = run(&mut stage(&motion), recording.input());
    assert!(errors(&motion, &recording, &late).1 > 0.05);
    assert!(errors(&motion, &recording, &aligned).1 < 2.0 * MILLIMETRE);
}

#[test]
fn an_older_pose_is_carried_on_to_the_frame_by_the_samples_kept_since() {
    let motion = Motion::walking();
    let mut stage = stage(&motion);
    for seq in 10..26 {
        let mut recording = motion.scan(seq);
        // The odometry is three frames behind.
        recording.prior = motion.pose(recording.header.frame.start_ns - 3 * FRAME_NS);
        let (header, points, _) = run(&mut stage, recording.input());
        assert_eq!(header.scan_flags, scan_flags::DESKEWED);
        if seq >= 14 {
            let (_, after) = errors(&motion, &recording, &points);
            assert!(after < MILLIMETRE, "frame {seq}: {after} m");
        }
    }
}

#[test]
fn when_the_odometry_stops_the_last_pose_goes_on_alone() {
    let motion = Motion::walking();
    let mut stage = stage(&motion);
    run(&mut stage, motion.scan(20).input());
    let recording = motion.scan(21);
    let (_, points, _) = run(&mut stage, recording.input_without_prior());
    let (before, after) = errors(&motion, &recording, &points);
    assert!(before > 1.0 && after < MILLIMETRE, "{before} -> {after} m");
}

#[test]
fn a_pose_that_is_lost_too_old_or_broken_is_not_used() {
    let motion = Motion::walking();
    let recording = motion.scan(20);
    let (_, without, _) = run(&mut stage(&motion), recording.input_without_prior());
    let unfit: [fn(&mut PoseFrame); 7] = [
        |pose| pose.state = TrackingState::Lost as u32,
        |pose| pose.state = TrackingState::Initialising as u32,
        |pose| pose.frame.end_ns -= 700_000_000,
        |pose| pose.frame.end_ns += 60_000_000,
        |pose| pose.velocity[1] = f64::NAN,
        |pose| pose.imu_orientation = [0.0; 4],
        |pose| pose.gravity = [0.0; 3],
    ];
    for (i, spoil) in unfit.iter().enumerate() {
        let mut pose = recording.prior;
        spoil(&mut pose);
        let (_, points, _) =
            run(&mut stage(&motion), ScanWithImu { prior: Some(&pose), ..recording.input() });
        assert_eq!(points, without, "spoilt pose {i}");
    }
    let config = DeskewerConfig { use_prior: false, ..Default::default() };
    let (_, ignored, _) = run(&mut Deskewer::new(config, &motion.rig).unwrap(), recording.input());
    assert_eq!(ignored, without);
}

#[test]
fn an_odometry_that_starts_in_motion_is_believed_before_it_tracks_if_most_of_its_points_fit() {
    let motion = Motion::walking();
    let recording = motion.scan(20);
    let (_, with, _) = run(&mut stage(&motion), recording.input());
    let (_, without, _) = run(&mut stage(&motion), recording.input_without_prior());
    assert_ne!(with, without);
    for (quality, expected) in [(0.9, &with), (0.2, &without)] {
        let mut pose = recording.prior;
        (pose.state, pose.quality) = (TrackingState::Initialising as u32, quality);
        let (_, points, _) =
            run(&mut stage(&motion), ScanWithImu { prior: Some(&pose), ..recording.input() });
        assert_eq!(&points, expected, "quality {quality}");
    }
}

#[test]
fn a_gap_of_40_ms_in_the_imu_is_bridged_to_a_centimetre() {
    let motion = Motion::walking();
    let mut recording = motion.scan(25);
    let start_ns = recording.header.frame.start_ns;
    recording.imu.retain(|sample| !(30_000_000..65_000_000).contains(&(sample.stamp_ns - start_ns)));
    let (header, points, _) = run(&mut stage(&motion), recording.input());
    let (before, after) = errors(&motion, &recording, &points);
    assert_eq!(header.scan_flags, scan_flags::DESKEWED);
    assert!(before > 1.0 && after < 10.0 * MILLIMETRE, "{before} -> {after} m");
}

#[test]
fn where_the_imu_does_not_cover_the_scan_it_passes_on_unchanged_marked_and_counted() {
    let motion = Motion::walking();
    let whole = motion.scan(25);
    let half: Vec<_> = whole.imu.iter().copied().take(10).collect();
    let early: Vec<_> =
        whole.imu.iter().copied().filter(|s| s.stamp_ns < whole.header.frame.start_ns).collect();
    let inputs = [
        ScanWithImu { imu: &[], imu_covers: false, ..whole.input() },
        ScanWithImu { imu: &half, imu_covers: false, ..whole.input() },
        ScanWithImu { imu: &[], ..whole.input() },
        ScanWithImu { imu: &early, imu_covers: false, ..whole.input() },
    ];
    for (i, input) in inputs.into_iter().enumerate() {
        let (header, points, counters) = run(&mut stage(&motion), input);
        assert_eq!(header.scan_flags, scan_flags::IMU_MISSING, "case {i}");
        assert_eq!(points, whole.points, "case {i}");
        assert_eq!(counters, Counters { degraded: 1, ..Default::default() }, "case {i}");
    }
}

#[test]
fn an_interval_without_samples_longer_than_allowed_is_not_bridged() {
    let motion = Motion::walking();
    let mut recording = motion.scan(25);
    let start_ns = recording.header.frame.start_ns;
    recording.imu.retain(|sample| !(10_000_000..85_000_000).contains(&(sample.stamp_ns - start_ns)));
    let config = DeskewerConfig { max_imu_gap_s: 0.05, ..Default::default() };
    let mut strict = Deskewer::new(config, &motion.rig).unwrap();
    let (header, points, counters) = run(&mut strict, recording.input());
    assert_eq!((header.scan_flags, counters.degraded), (scan_flags::IMU_MISSING, 1));
    assert_eq!(points, recording.points);
}

#[test]
fn one_stamp_far_in_the_future_does_not_shut_out_the_samples_after_it() {
    let motion = Motion::walking();
    let mut stage = stage(&motion);
    let mut recording = motion.scan(24);
    recording.imu[5].stamp_ns += 3_600_000_000_000;
    run(&mut stage, recording.input());
    let recording = motion.scan(25);
    let (header, points, _) = run(&mut stage, recording.input());
    assert_eq!(header.scan_flags, scan_flags::DESKEWED);
    assert!(errors(&motion, &recording, &points).1 < MILLIMETRE);
}

#[test]
fn deskewing_resumes_with_the_imu_after_an_outage() {
    let motion = Motion::turning();
    let mut stage = stage(&motion);
    for seq in 0..30 {
        let recording = motion.scan(seq);
        let outage = (18..26).contains(&seq);
        let input = ScanWithImu {
            imu: if outage { &[] } else { &recording.imu },
            imu_covers: !outage,
            ..recording.input_without_prior()
        };
        let (header, points, _) = run(&mut stage, input);
        assert_eq!(header.scan_flags == scan_flags::DESKEWED, !outage, "frame {seq}");
        if seq > 26 {
            let (before, after) = errors(&motion, &recording, &points);
            assert!(before > 1.0 && after < 10.0 * MILLIMETRE, "frame {seq}: {before} -> {after} m");
        }
    }
}

#[test]
fn broken_far_near_and_absent_returns_are_dropped_and_counted_and_the_rest_keep_order_time_and_reflectivity()
{
    let motion = Motion::turning();
    let mut recording = motion.scan(20);
    let kept = recording.points.clone();
    let bad = |x, y, z| Point::new(x, y, z, 50_000_000, 7);
    let absent = [bad(0.0, 0.0, 0.0); 3];
    let broken = [
        bad(f32::NAN, 1.0, 1.0),
        bad(1.0, f32::INFINITY, 1.0),
        bad(1.0, 1.0, f32::NEG_INFINITY),
        bad(0.05, 0.05, 0.05),
        bad(300.0, 0.0, 0.0),
        bad(1e30, 0.0, 0.0),
    ];
    for (i, point) in absent.iter().chain(&broken).enumerate() {
        recording.points.insert(i * 1000, *point);
    }
    recording.header.rejected = 5;
    let (header, points, counters) = run(&mut stage(&motion), recording.input());
    assert_eq!((header.no_return, header.rejected, counters.rejected), (3, 11, 6));
    assert_eq!(points.len(), POINTS);
    for (point, original) in points.iter().zip(&kept) {
        assert_eq!(point.packed, original.packed);
        assert!(point.is_finite());
    }
}

#[test]
fn points_need_no_order_of_time() {
    let motion = Motion::walking();
    let mut recording = motion.scan(20);
    let (_, sorted, _) = run(&mut stage(&motion), recording.input());
    recording.points.reverse();
    let (_, mut reversed, _) = run(&mut stage(&motion), recording.input());
    reversed.reverse();
    assert_eq!(sorted, reversed);
}

#[test]
fn a_point_at_the_end_of_the_frame_stays_where_it_is() {
    let motion = Motion::walking();
    let mut recording = motion.scan(20);
    recording.points = vec![Point::new(25.0, 3.0, -2.0, FRAME_NS, 9); 4];
    let (_, points, _) = run(&mut stage(&motion), recording.input());
    for point in points {
        assert!(
            (point.x - 25.0).abs() < 1e-5 && (point.y - 3.0).abs() < 1e-5 && (point.z + 2.0).abs() < 1e-5
        );
    }
}

#[test]
fn a_scan_that_is_deskewed_already_is_not_deskewed_twice() {
    let motion = Motion::walking();
    let mut recording = motion.scan(20);
    recording.header.scan_flags = scan_flags::DESKEWED | scan_flags::TIMES_ASSUMED;
    let (header, points, counters) = run(&mut stage(&motion), recording.input());
    assert_eq!(points, recording.points);
    assert_eq!((header.scan_flags, counters.degraded), (recording.header.scan_flags, 0));
}

#[test]
fn a_sensor_clock_that_starts_anew_starts_the_deskewer_anew() {
    let motion = Motion::turning();
    let mut stage = stage(&motion);
    let frames = |stage: &mut Deskewer| -> Vec<Vec<Point>> {
        (0..20).map(|seq| run(stage, motion.scan(seq).input_without_prior()).1).collect()
    };
    let first = frames(&mut stage);
    assert_eq!(first, frames(&mut stage));
}

#[test]
fn broken_times_and_samples_neither_panic_nor_let_anything_through_that_is_not_finite() {
    let motion = Motion::walking();
    let extremes = [i64::MIN, i64::MIN + 1, -1, 0, 1, i64::MAX - 1, i64::MAX];
    let mut stage = stage(&motion);
    for start_ns in extremes {
        for end_ns in extremes {
            let mut recording = motion.scan(20);
            recording.header.frame.start_ns = start_ns;
            recording.header.frame.end_ns = end_ns;
            for (sample, stamp_ns) in recording.imu.iter_mut().zip(extremes) {
                sample.stamp_ns = stamp_ns;
                sample.gyro = [f64::MAX, f64::NAN, stamp_ns as f64];
            }
            recording.prior.frame.end_ns = end_ns;
            recording.prior.time_offset_ns = start_ns;
            let (_, points, _) = run(&mut stage, recording.input());
            assert!(points.iter().all(Point::is_finite));
        }
    }
}

#[test]
fn two_runs_over_the_same_frames_give_the_same_bytes() {
    let motion = Motion::walking();
    let walk = || -> Vec<(ScanHeader, Vec<Point>)> {
        let mut stage = stage(&motion);
        (0..24)
            .map(|seq| {
                let recording = motion.scan(seq);
                let input = if seq % 3 == 0 { recording.input_without_prior() } else { recording.input() };
                let (header, points, _) = run(&mut stage, input);
                (header, points)
            })
            .collect()
    };
    assert_eq!(walk(), walk());
}

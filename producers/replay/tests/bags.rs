//! What drivers publish differently and must come out the same.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::bag::{Bag, F32, F64, U32, cloud, custom};
use common::{Told, error_of, tell};
use evac_frames::scan_flags;
use evac_replay::{Config, GyroUnit, ImuUnit};
use evac_stage::Counters;

const CLOUD: &str = "sensor_msgs/PointCloud2";
const CUSTOM: &str = "livox_ros_driver2/CustomMsg";
const START: i64 = 1_700_000_000_000_000_000;
const MS: i64 = 1_000_000;

fn config(bag: &Bag, folder: &tempfile::TempDir) -> Config {
    Config { bag: Some(bag.write(folder.path())), ..Config::default() }
}

/// Three clouds of 100 ms and 100 points whose times are made by `time` from cloud stamp and offset in seconds.
fn three_clouds(field: Option<(&str, u8)>, stamp_shift_ns: i64, time: impl Fn(i64, f64) -> f64) -> Told {
    let mut bag = Bag::new();
    for k in 0..3 {
        let start = START + k * 100 * MS;
        let times: Vec<f64> = (0..100).map(|i| time(start, f64::from(i) * 1e-3)).collect();
        bag.push("/points", CLOUD, cloud(start + stamp_shift_ns, &times, field));
    }
    bag.push_imu(START, 0.4, 9.81);
    tell(config(&bag, &tempfile::tempdir().unwrap()), usize::MAX)
}

#[test]
fn every_common_form_of_point_time_gives_the_same_scan() {
    let since_start = |unit: f64| move |_: i64, offset: f64| (offset * unit).round();
    let seconds = |_: i64, offset: f64| offset;
    let told = [
        three_clouds(Some(("time", F32)), 0, seconds),
        three_clouds(Some(("time", F64)), 0, seconds),
        three_clouds(Some(("t", U32)), 0, since_start(1e9)),
        three_clouds(Some(("offset_time", U32)), 0, since_start(1e9)),
        three_clouds(Some(("time", F32)), 0, since_start(1e6)),
        three_clouds(Some(("time", F32)), 0, since_start(1e3)),
        three_clouds(Some(("timestamp", F64)), 0, |start, offset| start as f64 + offset * 1e9),
        three_clouds(Some(("timestamp", F64)), 0, |start, offset| start as f64 * 1e-9 + offset),
        // stamped at the last point, with times that count backwards
        three_clouds(Some(("time", F32)), 99 * MS, |_, offset| offset - 0.099),
        // absolute times count, whatever the stamp
        three_clouds(Some(("timestamp", F64)), 7 * MS, |start, offset| start as f64 + offset * 1e9),
        three_clouds(None, 0, seconds),
    ];
    for (form, told) in told.iter().enumerate() {
        assert_eq!(told.scans.len(), 3, "form {form}");
        for (k, header) in told.scans.iter().enumerate() {
            let start = START + k as i64 * 100 * MS;
            // Absolute times in seconds have steps of 238 ns.
            assert!((header.frame.start_ns - start).abs() < 500, "form {form}: {}", header.frame.start_ns);
            assert!(
                (header.frame.end_ns - start - 100 * MS).abs() < 500,
                "form {form}: {}",
                header.frame.end_ns
            );
            assert_eq!(header.scan_flags & scan_flags::TIMES_ASSUMED != 0, form == told_without_times(told));
        }
        for (index, point) in told.points.iter().enumerate() {
            let expected = index as i64 % 100 * MS;
            assert!(
                (point.offset_ns() - expected).abs() < 500,
                "form {form}: point {index} at {}",
                point.offset_ns()
            );
            assert_eq!(point.x, (index % 100 + 1) as f32);
        }
    }

    fn told_without_times(told: &Told) -> usize {
        if told.scans[0].scan_flags == 0 { usize::MAX } else { 10 }
    }
}

#[test]
fn clouds_without_times_at_20_hz_are_spread_over_50_ms() {
    let mut bag = Bag::new();
    for k in [0, 1, 2, 5] {
        bag.push("/points", CLOUD, cloud(START + k * 50 * MS, &[0.0; 50], None));
    }
    bag.push_imu(START, 0.5, 9.81);
    let told = tell(config(&bag, &tempfile::tempdir().unwrap()), usize::MAX);
    assert!(told.scans.iter().all(|header| header.frame.end_ns - header.frame.start_ns == 50 * MS));
    assert_eq!(told.points[149].offset_ns(), 49 * MS);
}

#[test]
fn the_unit_of_specific_force_is_told_by_gravity_or_by_the_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let accel = |gravity: f64, unit: ImuUnit| {
        let mut bag = Bag::new();
        bag.push("/livox/lidar", CUSTOM, custom(START, &[(0, 1.0), (99 * MS as u32, 1.0)]));
        bag.push_imu(START, 0.2, gravity);
        let told = tell(Config { imu_unit: unit, ..config(&bag, &folder) }, 0);
        told.imu[0].accel[2]
    };
    assert!((accel(1.004, ImuUnit::Auto) - 9.8459).abs() < 1e-3);
    assert!((accel(9.75, ImuUnit::Auto) - 9.75).abs() < 1e-12);
    assert!((accel(3.0, ImuUnit::G) - 29.42).abs() < 1e-3);
    assert!((accel(3.0, ImuUnit::MetresPerSecondSquared) - 3.0).abs() < 1e-12);
    let mut bag = Bag::new();
    bag.push("/livox/lidar", CUSTOM, custom(START, &[(0, 1.0)]));
    bag.push_imu(START, 0.2, 3.0);
    let refused = error_of(config(&bag, &folder));
    assert!(
        refused.contains("/imu") && refused.contains("3.000") && refused.contains("imu_unit"),
        "{refused}"
    );
}

#[test]
fn rates_in_degrees_are_told_by_how_gravity_turns_or_by_the_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let rate = |scale: f64, unit: GyroUnit| {
        let mut bag = Bag::new();
        for k in 0..75 {
            bag.push(
                "/livox/lidar",
                CUSTOM,
                custom(START + k * 100 * MS, &[(0, 1.0), (99 * MS as u32, 1.0)]),
            );
        }
        bag.push_tilting_imu(START, scale);
        let told = tell(Config { gyro_unit: unit, ..config(&bag, &folder) }, 0);
        told.imu[300].gyro[0]
    };
    let degrees = 1_f64.to_degrees();
    for (scale, unit, expected) in [
        (1.0, GyroUnit::Auto, 0.7),
        (degrees, GyroUnit::Auto, 0.7),
        (degrees, GyroUnit::DegreesPerSecond, 0.7),
        (degrees, GyroUnit::RadiansPerSecond, 0.7 * degrees),
        // Another range: said, and left as it is.
        (2.0, GyroUnit::Auto, 1.4),
    ] {
        let rate = rate(scale, unit);
        assert!((rate - expected).abs() < 1e-9, "{scale} {unit:?}: {rate}");
    }
}

#[test]
fn a_custom_msg_goes_before_a_point_cloud_and_the_topic_may_be_chosen() {
    let (folder, mut bag) = (tempfile::tempdir().unwrap(), Bag::new());
    for k in 0..2 {
        bag.push("/points", CLOUD, cloud(START + k * 100 * MS, &[0.0, 0.099], Some(("time", F32))));
    }
    bag.push("/livox/lidar", CUSTOM, custom(START, &[(0, 5.0), (99 * MS as u32, 6.0)]));
    bag.push_imu(START, 0.2, 1.0);
    let config = config(&bag, &folder);
    assert_eq!(tell(config.clone(), 9).points[0].x, 5.0);
    assert_eq!(tell(Config { lidar_topic: Some("/points".to_owned()), ..config }, 9).scans.len(), 2);
}

#[test]
fn streams_that_lie_one_after_the_other_in_the_bag_are_joined_by_time() {
    let mut bag = Bag::new();
    bag.push_imu(START, 2.0, 9.8);
    for k in 0..20 {
        bag.push("/livox/lidar", CUSTOM, custom(START + k * 100 * MS, &[(0, 1.0), (99 * MS as u32, 1.0)]));
    }
    // `tell` checks the order.
    let told = tell(config(&bag, &tempfile::tempdir().unwrap()), 0);
    assert_eq!((told.scans.len(), told.imu.len()), (20, 401));
}

#[test]
fn the_imu_covers_the_last_scan_by_one_sample_and_no_more() {
    let mut bag = Bag::new();
    bag.push("/livox/lidar", CUSTOM, custom(START, &[(0, 1.0), (98 * MS as u32, 1.0)]));
    bag.push_imu(START - 3000 * MS + 2 * MS, 4.0, 9.8);
    let told = tell(config(&bag, &tempfile::tempdir().unwrap()), 0);
    // From one second before the first scan to the first sample after the last.
    let (first, last) =
        (told.imu[0].stamp_ns - START, told.imu.last().unwrap().stamp_ns - told.scans[0].frame.end_ns);
    assert!((-1000 * MS..-995 * MS).contains(&first), "{first}");
    assert!((0..5 * MS).contains(&last), "{last}");
}

#[test]
fn points_that_are_not_finite_become_shots_without_return_and_are_counted() {
    let mut bag = Bag::new();
    let points = [(0, 1.0), (MS as u32, f32::NAN), (2 * MS as u32, f32::INFINITY), (3 * MS as u32, 0.0)];
    bag.push("/livox/lidar", CUSTOM, custom(START, &points));
    bag.push_imu(START, 0.1, 9.8);
    let told = tell(config(&bag, &tempfile::tempdir().unwrap()), 9);
    let header = told.scans[0];
    assert_eq!((header.points, header.rejected, header.no_return, told.returns), (4, 2, 1, 1));
    assert_eq!(told.counters, Counters { rejected: 2, ..Counters::default() });
}

#[test]
fn messages_that_are_not_finite_or_whose_times_do_not_rise_are_left_out_and_counted() {
    let mut bag = Bag::new();
    let scan = |bag: &mut Bag, milliseconds: i64| {
        let points = [(0, 1.0), (99 * MS as u32, 1.0)];
        bag.push("/livox/lidar", CUSTOM, custom(START + milliseconds * MS, &points));
    };
    // The third comes twice, and the second once more after it.
    [0, 100, 200, 200, 100, 300].into_iter().for_each(|start| scan(&mut bag, start));
    bag.push_imu(START, 0.2, 9.8);
    // 41 samples once more, then 11 with values that are not finite.
    bag.push_imu(START, 0.2, 9.8);
    bag.push_imu(START + 205 * MS, 0.05, f64::NAN);
    bag.push_imu(START + 260 * MS, 0.2, 9.8);
    let folder = tempfile::tempdir().unwrap();
    let config = Config { imu_unit: ImuUnit::MetresPerSecondSquared, ..config(&bag, &folder) };
    let told = tell(config, 0);
    assert_eq!(told.scans.len(), 4);
    assert!(told.imu.iter().all(|sample| sample.accel[2] == 9.8));
    assert_eq!(told.counters, Counters { late: 2 + 41, degraded: 0, rejected: 11 });
}

#[test]
fn bags_that_cannot_be_replayed_say_why() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |fill: &dyn Fn(&mut Bag), words: &[&str]| {
        let mut bag = Bag::new();
        fill(&mut bag);
        let error = error_of(config(&bag, &folder));
        for word in words.iter().chain(&["walk.bag"]) {
            assert!(error.contains(word), "\"{word}\" is not in: {error}");
        }
    };
    let scan = |bag: &mut Bag, start: i64| {
        bag.push("/livox/lidar", CUSTOM, custom(start, &[(0, 1.0), (99 * MS as u32, 1.0)]));
    };
    refused(&|bag| scan(bag, START), &["sensor_msgs/Imu", "/livox/lidar"]);
    refused(&|bag| bag.push_imu(START, 1.0, 9.8), &["CustomMsg", "/imu"]);
    let two_clocks = |bag: &mut Bag| {
        scan(bag, 5000 * MS);
        bag.push_imu(START, 1.0, 9.8);
    };
    refused(&two_clocks, &["different clocks", "imu_offset_ms near -1699999995000"]);
    let restarted = |bag: &mut Bag| {
        for start in [START, START + 100 * MS, START - 5000 * MS] {
            scan(bag, start);
        }
        bag.push_imu(START, 1.0, 9.8);
    };
    refused(&restarted, &["byte ", "goes back", "restarted"]);
    let slow = |bag: &mut Bag| {
        bag.push("/livox/lidar", CUSTOM, custom(START, &[(0, 1.0), (199 * MS as u32, 1.0)]));
        bag.push_imu(START, 1.0, 9.8);
    };
    refused(&slow, &["byte ", "199 ms", "10 frames a second"]);
    let slow_clouds = |bag: &mut Bag| {
        for k in 0..3 {
            bag.push("/points", CLOUD, cloud(START + k * 200 * MS, &[0.0; 4], None));
        }
        bag.push_imu(START, 1.0, 9.8);
    };
    refused(&slow_clouds, &["each 200 ms", "10 clouds a second"]);
    let odd_times = |bag: &mut Bag| {
        bag.push("/points", CLOUD, cloud(START, &[0.0, 1e-7], Some(("time", F64))));
        bag.push_imu(START, 1.0, 9.8);
    };
    refused(&odd_times, &["byte ", "in no unit"]);
    let short = |bag: &mut Bag| {
        bag.push("/livox/lidar", CUSTOM, custom(START, &[(0, 1.0)])[..40].to_vec());
        bag.push_imu(START, 1.0, 9.8);
    };
    refused(&short, &["byte ", "/livox/lidar", "ends inside"]);
}

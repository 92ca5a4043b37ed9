//! Whole recordings of the test data: how many scans, points and IMU samples come out, and when.

mod common;

use common::{bag, tell, walk};
use evac_frames::{Point, frame_flags, scan_flags};
use evac_geometry::{GyroScale, GyroScaleCheck};
use evac_replay::Config;
use evac_stage::Counters;

const MS: i64 = 1_000_000;

#[test]
fn every_walk_gives_its_scans_of_100_ms_and_its_imu_at_200_hz() {
    for (name, scans) in [("corridor", 531), ("hall", 447), ("shake", 213)] {
        let Some(config) = walk(name) else { return };
        let told = tell(config, 0);
        assert_eq!((told.scans.len(), told.total), (scans, Some(scans as u64)), "{name}");
        for (k, header) in told.scans.iter().enumerate() {
            let start = k as i64 * 100 * MS;
            assert_eq!((header.frame.start_ns, header.frame.end_ns), (start, start + 100 * MS));
            assert_eq!((header.points, header.lost_packets, header.rejected), (10_000, 0, 0));
            assert_eq!(header.frame.flags & frame_flags::END_OF_STREAM != 0, k + 1 == scans);
        }
        let no_return: u64 = told.scans.iter().map(|header| u64::from(header.no_return)).sum();
        assert_eq!(told.returns + no_return, scans as u64 * 10_000);
        assert_eq!(told.counters, Counters::default(), "{name}: nothing is left out of a whole recording");
        // 2 % drop-outs by the data's README
        let share = no_return as f64 / (scans as f64 * 1e4);
        assert!((0.015..0.06).contains(&share), "{name}: {share} without return");
        // The log holds 20 samples a scan from time 0 on; none of them is at the last scan's very end.
        assert_eq!(told.imu.len(), scans * 20, "{name}");
        assert!(told.imu.iter().enumerate().all(|(k, sample)| sample.stamp_ns == k as i64 * 5 * MS));
        // The shortest standstill at the start of a walk is a little over a second.
        let resting = &told.imu[..200];
        let norm =
            resting.iter().map(|s| s.accel.iter().map(|a| a * a).sum::<f64>().sqrt()).sum::<f64>() / 200.0;
        assert!((9.7..9.95).contains(&norm), "{name}: {norm} m/s^2 at rest");
    }
}

#[test]
fn imu_times_follow_the_configured_rate_and_offset() {
    let Some(config) = walk("shake") else { return };
    let told = tell(Config { imu_offset_ms: -2.5, ..config }, 0);
    assert_eq!(told.imu[0].stamp_ns, -2_500_000);
    assert_eq!(told.imu[4001].stamp_ns - told.imu[4000].stamp_ns, 5 * MS);
}

#[test]
fn bags_with_bz2_and_lz4_chunks_give_their_scans_and_imu() {
    for (path, scans) in
        [("simulated/bags/hall_first_6s_bz2.bag", 60), ("simulated/bags/hall_first_2s_lz4.bag", 20)]
    {
        let Some(config) = bag(path) else { return };
        let told = tell(config, 0);
        assert_eq!((told.scans.len(), told.total), (scans, Some(scans as u64)), "{path}");
        let zero = 1_700_000_000_000 * MS;
        for (k, header) in told.scans.iter().enumerate() {
            let start = zero + k as i64 * 100 * MS;
            assert_eq!((header.frame.start_ns, header.frame.end_ns), (start, start + 100 * MS), "{path}");
            // These bags hold no shots without return.
            assert!(
                (9_000..10_000).contains(&header.points) && header.no_return == 0 && header.scan_flags == 0
            );
        }
        assert_eq!(told.scans.last().unwrap().frame.flags, frame_flags::END_OF_STREAM);
        assert_eq!(told.imu.len(), scans * 20, "{path}");
        assert_eq!(told.imu[0].stamp_ns, zero);
    }
}

#[test]
fn the_hall_s_bag_and_capture_agree() {
    let (Some(from_bag), Some(from_capture)) = (bag("simulated/bags/hall_first_2s_lz4.bag"), walk("hall"))
    else {
        return;
    };
    let as_cloud = Config { lidar_topic: Some("/livox/points".to_owned()), ..from_bag.clone() };
    let mut capture = tell(from_capture, 20);
    capture.points.retain(Point::is_return);
    for config in [from_bag, as_cloud] {
        let bag = tell(config, 20);
        assert_eq!(bag.points.len(), capture.points.len());
        for (a, b) in bag.points.iter().zip(&capture.points) {
            let apart = [a.x - b.x, a.y - b.y, a.z - b.z].map(f32::abs);
            assert!(apart.iter().all(|d| *d < 1e-3), "{a:?} is not {b:?}");
            assert!(
                (a.offset_ns() - b.offset_ns()).abs() <= 20,
                "{} ns is not {} ns",
                a.offset_ns(),
                b.offset_ns()
            );
        }
        let zero = bag.imu[0].stamp_ns;
        for (a, b) in bag.imu.iter().zip(&capture.imu) {
            assert!((a.stamp_ns - zero - b.stamp_ns).abs() < 1000);
            for axis in 0..3 {
                assert!((a.gyro[axis] - b.gyro[axis]).abs() < 1e-6, "{a:?} is not {b:?}");
                // The log was scaled by 9.8 m/s^2, here it is read by 9.80665.
                assert!((a.accel[axis] * 9.80665 / 9.8 - b.accel[axis]).abs() < 1e-3, "{a:?} is not {b:?}");
            }
        }
    }
}

#[test]
fn a_real_tele15_gives_all_its_points_and_its_own_imu_in_si_units() {
    let Some(path) = evac_testkit::data("real/livox_tele15_pcap/livox_tele15_small.pcap") else { return };
    let told = tell(Config { lidar: Some(path), ..Config::default() }, usize::MAX);
    // 0.369 s: three whole scans and one of 0.07 s
    assert_eq!(told.scans.len(), 4);
    assert_eq!(told.points.len(), 88_896);
    assert_eq!(told.returns, 88_844);
    assert_eq!(told.imu.len(), 74);
    let ranges = told.points.iter().filter(|p| p.is_return()).map(|p| p.x.hypot(p.y).hypot(p.z));
    let (low, high) = ranges.fold((f32::MAX, 0_f32), |(low, high), r| (low.min(r), high.max(r)));
    assert!((low - 15.91).abs() < 0.01 && (high - 28.92).abs() < 0.01, "{low} to {high} m");
    let norm = told.imu.iter().map(|s| s.accel.iter().map(|a| a * a).sum::<f64>().sqrt()).sum::<f64>() / 74.0;
    assert!((norm / 9.80665 - 0.9937).abs() < 0.002, "{norm}");
    assert!(
        told.scans
            .iter()
            .all(|header| header.lost_packets == 0 && header.scan_flags & scan_flags::TIMES_ASSUMED == 0)
    );
    for pair in told.imu.windows(2) {
        let spacing = pair[1].stamp_ns - pair[0].stamp_ns;
        assert!((4_900_000..5_100_000).contains(&spacing), "{spacing}");
    }
}

#[test]
fn two_replays_of_one_recording_are_equal() {
    let Some(config) = bag("simulated/bags/hall_first_2s_lz4.bag") else { return };
    let (a, b) = (tell(config.clone(), usize::MAX), tell(config, usize::MAX));
    assert_eq!((a.scans, a.imu, a.points), (b.scans, b.imu, b.points));
}

/// A recording whose IMU is the LiDAR's own.
fn packets(path: &str) -> Option<common::Told> {
    Some(tell(Config { lidar: Some(evac_testkit::data(path)?), ..Config::default() }, usize::MAX))
}

#[test]
fn an_official_recording_of_an_avia_gives_its_points_and_imu() {
    let Some(told) = packets("protocols/lvx/avia_3frames_official_sample_prefix.lvx") else { return };
    // 148 ms; the last third of a scan is left out.
    assert_eq!((told.scans.len(), told.scans[0].frame.start_ns), (1, 5_000_000_000));
    assert!(told.imu.len() >= 20 && told.imu.iter().all(|sample| (sample.accel[2] - 9.80665).abs() < 1e-6));
    assert!(told.points.len() > 9_000 && told.returns > 9_000, "{} points", told.points.len());
}

#[test]
fn a_mid_360_s_capture_gives_its_points_and_imu() {
    let Some(told) = packets("protocols/pcap/sdk2_mid360_session.pcap") else { return };
    // 250 packets of 96 points, one each 960 us; the last 40 ms are left out.
    assert_eq!(told.scans.len(), 2);
    assert!((19_990..=20_020).contains(&told.points.len()), "{} points", told.points.len());
    assert!(told.imu.len() >= 40, "{} samples", told.imu.len());
    assert_eq!(told.counters.late, 0);
}

#[test]
fn a_part_of_a_recording_is_the_same_scans_as_in_the_whole() {
    let Some(config) = bag("simulated/bags/hall_first_2s_lz4.bag") else { return };
    let whole = tell(config.clone(), usize::MAX);
    let part = tell(Config { start_s: 0.5, duration_s: 0.75, ..config.clone() }, usize::MAX);
    assert_eq!((part.scans.len(), part.total), (8, None));
    for (index, (part, whole)) in part.scans.iter().zip(&whole.scans[5..]).enumerate() {
        assert_eq!((part.frame.start_ns, part.points), (whole.frame.start_ns, whole.points));
        assert_eq!(part.frame.flags & frame_flags::END_OF_STREAM != 0, index == 7);
    }
    let first = whole.scans[..5].iter().map(|scan| scan.points as usize).sum::<usize>();
    assert_eq!(part.points, whole.points[first..first + part.points.len()]);
    assert_eq!(part.counters, Counters::default());
    let said = common::error_of(Config { start_s: 2.5, ..config });
    assert!(said.contains("start_s = 2.5") && said.contains("2.0 s"), "{said}");
}

#[test]
fn bags_of_all_kinds_that_rosbags_has_written_give_the_same_scans_and_imu() {
    let folder = tempfile::tempdir().unwrap();
    let Some(written) = evac_testkit::ros_libraries(&["write".as_ref(), folder.path()]) else { return };
    written.unwrap();
    for topic in ["/livox/lidar", "/livox/points"] {
        let read = |name: &str| {
            let bag = Some(folder.path().join(name));
            tell(Config { bag, lidar_topic: Some(topic.to_owned()), ..Config::default() }, usize::MAX)
        };
        let ros1 = read("walk.bag");
        assert_eq!((ros1.scans.len(), ros1.points.len(), ros1.imu.len()), (12, 12_000, 240), "{topic}");
        let point = ros1.points[1003];
        assert_eq!((point.y, point.z, point.offset_ns(), point.reflectivity()), (1.5, -0.25, 300_000, 3));
        assert!((point.x - 1.03).abs() < 1e-6 && (ros1.imu[0].accel[2] - 9.80665).abs() < 1e-9);
        for name in ["mcap", "mcap/mcap.mcap", "db3", "db3/db3.db3"] {
            let ros2 = read(name);
            assert_eq!((&ros2.scans, &ros2.imu), (&ros1.scans, &ros1.imu), "{name} {topic}");
            assert_eq!(ros2.points, ros1.points, "{name} {topic}");
        }
    }
}

#[test]
fn gravity_accuses_no_gyroscope_of_a_walk_and_knows_degrees_from_radians_in_every_one() {
    for name in ["corridor", "hall", "shake"] {
        let Some(config) = walk(name) else { return };
        let imu = tell(config, 0).imu;
        let verdict = |scale: f64| {
            let mut check = GyroScaleCheck::new(9.80665);
            imu.iter().for_each(|s| check.push(s.stamp_ns, s.gyro.map(|rate| rate * scale), s.accel));
            check.verdict()
        };
        assert!(matches!(verdict(1.0), GyroScale::Unknown | GyroScale::Right), "{name}: {:?}", verdict(1.0));
        let degrees = 1_f64.to_degrees();
        assert_eq!(verdict(degrees), GyroScale::Times(degrees), "{name}");
    }
}

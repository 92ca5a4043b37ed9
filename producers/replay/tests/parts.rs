//! A part of a recording is the same scans and IMU samples as in the whole, whatever the format.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{Told, bag, tell, walk};
use evac_frames::{ScanHeader, frame_flags};
use evac_replay::Config;

/// Replays the middle third, by `start_s` and `duration_s`, and compares it with the whole.
#[track_caller]
fn assert_part_of_whole(name: &str, config: &Config) {
    let whole = tell(config.clone(), usize::MAX);
    let scans = whole.scans.len();
    assert!(scans >= 6, "{name}: {scans} scans");
    let (first, last) = (scans / 3, 2 * scans / 3);
    let frame = |at: usize| whole.scans[at].frame;
    let from_ns = frame(first).start_ns - frame(0).start_ns;
    let until_ns = frame(last).end_ns - frame(first).start_ns;
    // A little earlier each, so that neither hangs on the last digit of a second.
    let part = Config {
        start_s: from_ns as f64 * 1e-9 - 1e-4,
        duration_s: until_ns as f64 * 1e-9 - 1e-4,
        ..config.clone()
    };
    let part = tell(part, usize::MAX);
    assert_eq!(part.scans.len(), last - first + 1, "{name}");
    let without_flags = |header: &ScanHeader| {
        let mut header = *header;
        header.frame.flags &= !frame_flags::END_OF_STREAM;
        header
    };
    for (index, (part, whole)) in part.scans.iter().zip(&whole.scans[first..]).enumerate() {
        assert_eq!(without_flags(part), without_flags(whole), "{name}: scan {index}");
        assert_eq!(part.frame.flags & frame_flags::END_OF_STREAM != 0, index == last - first, "{name}");
    }
    let before: usize = whole.scans[..first].iter().map(|scan| scan.points as usize).sum();
    assert!(part.points == whole.points[before..before + part.points.len()], "{name}: points differ");
    assert_imu_of_whole(name, &part, &whole);
}

/// The samples lie one after the other in the whole, from at most a second before the first scan to one after the last's end.
#[track_caller]
fn assert_imu_of_whole(name: &str, part: &Told, whole: &Told) {
    let (start_ns, end_ns) = (part.scans[0].frame.start_ns, part.scans.last().unwrap().frame.end_ns);
    let wanted: Vec<_> =
        whole.imu.iter().filter(|sample| sample.stamp_ns >= start_ns - 1_000_000_000).collect();
    let until = wanted.iter().position(|sample| sample.stamp_ns >= end_ns).map_or(wanted.len(), |at| at + 1);
    assert!(until > 0, "{name}: no IMU");
    assert!(part.imu.iter().eq(wanted[..until].iter().copied()), "{name}: IMU samples differ");
}

/// A capture or LVX recording with the LiDAR's own IMU, cut into short scans as it is short itself.
fn own_imu(path: &str) -> Option<Config> {
    Some(Config { lidar: Some(evac_testkit::data(path)?), scan_period_ms: 20.0, ..Config::default() })
}

#[test]
fn captures_with_a_byte_log_are_cut_at_scans() {
    let Some(config) = walk("shake") else { return };
    assert_part_of_whole("SDK1 capture and byte log", &config);
}

#[test]
fn captures_with_the_lidar_s_own_imu_are_cut_at_scans() {
    for (name, path) in [
        ("SDK1 capture", "real/livox_tele15_pcap/livox_tele15_small.pcap"),
        ("SDK2 capture", "protocols/pcap/sdk2_mid360_session.pcap"),
        ("LVX 1.1", "protocols/lvx/avia_3frames_official_sample_prefix.lvx"),
    ] {
        let Some(config) = own_imu(path) else { return };
        assert_part_of_whole(name, &config);
    }
}

#[test]
fn bags_of_ros_1_are_cut_at_messages() {
    for name in ["hall_first_6s_bz2", "hall_first_2s_lz4"] {
        let Some(config) = bag(&format!("simulated/bags/{name}.bag")) else { return };
        assert_part_of_whole(name, &config);
    }
}

#[test]
fn bags_of_all_kinds_that_rosbags_has_written_are_cut_at_messages() {
    let folder = tempfile::tempdir().unwrap();
    let Some(written) = evac_testkit::ros_libraries(&["write".as_ref(), folder.path()]) else { return };
    written.unwrap();
    for name in ["walk.bag", "mcap", "db3"] {
        for topic in ["/livox/lidar", "/livox/points"] {
            let bag = Some(folder.path().join(name));
            let config = Config { bag, lidar_topic: Some(topic.to_owned()), ..Config::default() };
            assert_part_of_whole(&format!("{name} {topic}"), &config);
        }
    }
}

#[test]
fn lvx_is_cut_at_scans_with_a_byte_log_beside_it() {
    let Some(imu) = evac_testkit::data("protocols/wt901c/wt901c_200hz_10s_clean.bin") else { return };
    let Some(lidar) = evac_testkit::data("protocols/lvx/mid40_1s_official_sample.lvx") else { return };
    let config = Config { lidar: Some(lidar), imu: Some(imu), scan_period_ms: 50.0, ..Config::default() };
    assert_part_of_whole("LVX 1.1", &config);
}

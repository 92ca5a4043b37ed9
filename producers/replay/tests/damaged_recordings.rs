//! Recordings that are not as they should be: one clear error with file, place and remedy, or a counted repair.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::{bag, error_of, open, tell, walk};
use evac_formats::livox_sdk1::{CartesianMm, DATAGRAM_SHOTS, DataFields, encode_cartesian, encode_imu};
use evac_formats::pcap::PcapWriter;
use evac_formats::wt901c::{encode_accel, encode_gyro};
use evac_replay::Config;
use evac_stage::{Counters, Source};

const LIDAR: &str = "192.168.1.11:65000";
const HOST: &str = "192.168.1.50:60001";
const MS: u64 = 1_000_000;

/// A capture of packets at `stamps` milliseconds, each of 100 shots at 2 m.
fn capture(folder: &Path, stamps: impl IntoIterator<Item = u64>) -> PathBuf {
    let path = folder.join("lidar.pcap");
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    let (shots, mut payload) =
        ([CartesianMm { position: [2000, 0, 0], reflectivity: 9 }; DATAGRAM_SHOTS], Vec::new());
    for stamp in stamps {
        encode_cartesian(stamp * MS, &shots, &mut payload);
        write(&mut writer, stamp, LIDAR, &payload);
    }
    fs::write(&path, writer.finish().unwrap()).unwrap();
    path
}

fn write(writer: &mut PcapWriter<Vec<u8>>, milliseconds: u64, source: &str, payload: &[u8]) {
    let (source, host) = (source.parse().unwrap(), HOST.parse().unwrap());
    writer.write_udp((milliseconds * MS) as i64, source, host, payload).unwrap();
}

/// A log of `samples` samples at rest.
fn log(folder: &Path, samples: usize) -> PathBuf {
    let path = folder.join("wt901c.bin");
    let sample = [encode_accel([0, 0, 2048], 2500), encode_gyro([0, 0, 0], 500)].concat();
    fs::write(&path, sample.repeat(samples)).unwrap();
    path
}

fn config(lidar: PathBuf, imu: PathBuf) -> Config {
    Config { lidar: Some(lidar), imu: Some(imu), ..Config::default() }
}

#[track_caller]
fn says(error: &str, words: &[&str]) {
    for word in words {
        assert!(error.contains(word), "\"{word}\" is not in: {error}");
    }
}

#[test]
fn lost_packets_are_counted_in_the_scan_they_are_missing_from() {
    let folder = tempfile::tempdir().unwrap();
    let lost = |ms: &u64| !(150..153).contains(ms) && !(290..420).contains(ms);
    let lidar = capture(folder.path(), (0..1000).filter(lost));
    let told = tell(config(lidar, log(folder.path(), 200)), 0);
    // A gap of more than 20 ms also costs its first packet: a stamp that far ahead is believed only with the next one.
    let counted: Vec<_> = told.scans.iter().map(|header| header.lost_packets).collect();
    assert_eq!(counted, [0, 3, 10, 100, 21, 0, 0, 0, 0, 0]);
    let points: Vec<_> = told.scans.iter().map(|header| header.points / 100).collect();
    assert_eq!(points, [100, 97, 90, 0, 79, 100, 100, 100, 100, 100]);
}

#[test]
fn a_packet_across_the_border_of_two_scans_is_divided_by_time() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    let shots = [CartesianMm { position: [2000, 0, 0], reflectivity: 9 }; 96];
    let mut payload = Vec::new();
    for packet in 0..500_u64 {
        encode_cartesian(packet * 960_000, &shots, &mut payload);
        write(&mut writer, packet, LIDAR, &payload);
    }
    let path = folder.path().join("lidar.pcap");
    fs::write(&path, writer.finish().unwrap()).unwrap();
    let told = tell(config(path, log(folder.path(), 100)), usize::MAX);
    assert!(told.scans.iter().take(4).all(|header| header.points == 10_000), "{:?}", told.scans);
    let offsets: Vec<_> = told.points.iter().take(20_000).map(|point| point.offset_ns()).collect();
    assert!(offsets.iter().enumerate().all(|(k, offset)| *offset == (k as i64 % 10_000) * 10_000));
}

#[test]
fn a_last_scan_of_less_than_half_a_period_is_left_out_and_a_longer_one_kept() {
    let folder = tempfile::tempdir().unwrap();
    for (packets, scans) in [(340, 3), (360, 4)] {
        let told = tell(config(capture(folder.path(), 0..packets), log(folder.path(), 80)), 0);
        assert_eq!(told.scans.len(), scans);
        assert_eq!(told.scans.iter().filter(|header| header.frame.flags != 0).count(), 1);
    }
}

#[test]
fn only_one_of_two_lidars_is_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    let mut payload = Vec::new();
    for ms in 0..400 {
        for (source, x) in [("10.0.0.1:65000", 1000), ("10.0.0.2:65000", 2000)] {
            let shots = [CartesianMm { position: [x, 0, 0], reflectivity: 1 }; DATAGRAM_SHOTS];
            encode_cartesian(ms * MS, &shots, &mut payload);
            write(&mut writer, ms, source, &payload);
        }
        if ms % 5 == 0 {
            encode_imu(&DataFields::power_on(ms * MS), [0.0; 3], [0.0, 0.0, 1.0], &mut payload);
            write(&mut writer, ms, "10.0.0.2:65001", &payload);
        }
    }
    let path = folder.path().join("two.pcap");
    fs::write(&path, writer.finish().unwrap()).unwrap();
    let second = Config { lidar: Some(path), lidar_ip: "10.0.0.2".parse().ok(), ..Config::default() };
    let told = tell(second.clone(), usize::MAX);
    assert_eq!(told.counters, Counters { rejected: 400, ..Counters::default() }, "the first one's packets");
    assert_eq!((told.scans.len(), told.points.len(), told.imu.len()), (4, 40_000, 80));
    assert!(told.points.iter().all(|point| point.x == 2.0));
    assert!((told.imu[7].accel[2] - 9.80665).abs() < 1e-9);
    // The first device sends no IMU data.
    says(&error_of(Config { lidar_ip: None, ..second.clone() }), &["two.pcap", "10.0.0.1", "no IMU", "imu"]);
    says(&error_of(Config { lidar_ip: "10.0.0.3".parse().ok(), ..second }), &["10.0.0.3", "lidar_ip"]);
}

#[test]
fn datagrams_that_are_damaged_doubled_or_strayed_in_time_are_left_out_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    let shots = [CartesianMm { position: [2000, 0, 0], reflectivity: 9 }; DATAGRAM_SHOTS];
    let mut payload = Vec::new();
    for ms in 0..400 {
        encode_cartesian(ms * MS, &shots, &mut payload);
        write(&mut writer, ms, LIDAR, &payload);
        match ms {
            // Cut short, and no Livox data at all.
            50 => write(&mut writer, ms, LIDAR, &payload[..payload.len() / 2]),
            51..53 => write(&mut writer, ms, LIDAR, b"hello"),
            100..107 => write(&mut writer, ms, LIDAR, &payload),
            200 => {
                encode_cartesian((ms + 3_600_000) * MS, &shots, &mut payload);
                write(&mut writer, ms, LIDAR, &payload);
            }
            _ => {}
        }
    }
    let path = folder.path().join("lidar.pcap");
    fs::write(&path, writer.finish().unwrap()).unwrap();
    let told = tell(config(path, log(folder.path(), 80)), 0);
    assert!(told.scans.iter().all(|header| (header.points, header.lost_packets) == (10_000, 0)));
    assert_eq!(told.counters, Counters { late: 7, degraded: 0, rejected: 4 });
}

#[test]
fn imu_samples_from_long_before_the_first_scan_are_left_out_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let early = config(capture(folder.path(), 0..1000), log(folder.path(), 1000));
    let told = tell(Config { imu_offset_ms: -3000.0, ..early }, 0);
    assert_eq!(told.imu[0].stamp_ns, -1_000_000_000);
    assert_eq!(told.counters, Counters { rejected: 400, ..Counters::default() });
}

#[test]
fn damaged_bytes_of_the_imu_log_leave_a_gap_and_shift_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let imu = log(folder.path(), 200);
    let mut bytes = fs::read(&imu).unwrap();
    bytes[22 * 50..22 * 53].fill(0);
    bytes[22 * 120 + 5] ^= 0x10;
    fs::write(&imu, bytes).unwrap();
    let told = tell(config(capture(folder.path(), 0..1000), imu), 0);
    let expected: Vec<i64> =
        (0..200).filter(|k| !(50..53).contains(k) && *k != 120).map(|k| k * 5_000_000).collect();
    assert_eq!(told.imu.iter().map(|sample| sample.stamp_ns).collect::<Vec<_>>(), expected);
    assert_eq!(told.counters, Counters { rejected: 4, ..Counters::default() });
}

#[test]
fn an_imu_log_of_another_walk_or_rate_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (lidar, imu) = (capture(folder.path(), 0..3000), log(folder.path(), 600));
    tell(config(lidar.clone(), imu.clone()), 0);
    let wrong_rate = Config { imu_rate_hz: 400.0, ..config(lidar.clone(), imu) };
    says(&error_of(wrong_rate), &["wt901c.bin", "byte 13200", "3.000 s", "imu_rate_hz"]);
    says(
        &error_of(config(lidar.clone(), log(folder.path(), 300))),
        &["covers 0.000 to 1.495 s", "whole log"],
    );
    let late = Config { imu_offset_ms: 5000.0, ..config(lidar, log(folder.path(), 600)) };
    says(&error_of(late), &["covers 5.000", "imu_offset_ms"]);
}

#[test]
fn a_clock_that_steps_and_a_recording_without_points_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let imu = log(folder.path(), 200);
    let lidar = capture(folder.path(), (1000..1500).chain(0..500));
    says(
        &error_of(config(lidar, imu.clone())),
        &["lidar.pcap", "byte ", "steps from 1.499 s to 0.001 s", "cut the capture"],
    );
    says(&error_of(config(capture(folder.path(), 0..30), imu.clone())), &["half a scan", "record longer"]);
    says(&error_of(config(capture(folder.path(), []), imu)), &["no Livox point data", "0 UDP datagrams"]);
}

#[test]
fn missing_and_empty_and_swapped_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let (lidar, imu) = (capture(folder.path(), 0..1000), log(folder.path(), 200));
    let (nowhere, empty) = (folder.path().join("nowhere"), folder.path().join("empty"));
    fs::write(&empty, []).unwrap();
    says(&error_of(config(nowhere.clone(), imu.clone())), &["nowhere", "check the path"]);
    says(&error_of(config(lidar.clone(), nowhere.clone())), &["nowhere", "check the path"]);
    says(&error_of(config(empty.clone(), imu.clone())), &["empty", "byte 0", "the file is empty", "record"]);
    says(
        &error_of(config(lidar.clone(), empty.clone())),
        &["empty", "byte 0", "the file is empty", "record"],
    );
    says(&error_of(config(imu, lidar.clone())), &["wt901c.bin", "byte 0", "WT901C byte log, not a pcap"]);
    says(&error_of(config(lidar.clone(), lidar.clone())), &["lidar.pcap", "byte 0", "no WT901C frame"]);
    for (path, words) in
        [(nowhere, "check the path"), (empty, "the file is empty"), (lidar, "this is no bag")]
    {
        says(&error_of(Config { bag: Some(path), ..Config::default() }), &[words]);
    }
    says(&error_of(Config::default()), &["configuration", "name the recording"]);
}

#[test]
fn cut_off_captures_and_logs_are_refused_and_used_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let (lidar, imu) = (capture(folder.path(), 0..1000), log(folder.path(), 200));
    for (path, cut, words) in
        [(&lidar, 700, "inside a packet"), (&imu, 5, "inside a sample"), (&imu, 11, "inside a sample")]
    {
        let whole = fs::read(path).unwrap();
        fs::write(path, &whole[..whole.len() - cut]).unwrap();
        let refused = config(lidar.clone(), imu.clone());
        says(
            &error_of(refused.clone()),
            &[path.file_name().unwrap().to_str().unwrap(), "byte ", words, "truncated"],
        );
        let told = tell(Config { allow_truncated: true, ..refused }, 0);
        assert_eq!(told.scans.len(), 10);
        fs::write(path, whole).unwrap();
    }
}

#[test]
fn a_cut_off_bag_is_refused_and_used_up_to_its_last_whole_chunk_on_request() {
    let Some(config) = bag("simulated/bags/hall_first_2s_lz4.bag") else { return };
    let whole = fs::read(config.bag.clone().unwrap()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.bag");
    let cut = Config { bag: Some(path.clone()), ..config };
    for share in [0.3, 0.5, 0.9] {
        let length = (whole.len() as f64 * share) as usize;
        fs::write(&path, &whole[..length]).unwrap();
        says(&error_of(cut.clone()), &["cut.bag", &format!("byte {length}"), "cut off", "rosbag reindex"]);
        let told = tell(Config { allow_truncated: true, ..cut.clone() }, 0);
        assert!(
            told.scans.len() as f64 > 20.0 * share - 4.0 && told.scans.len() < 20,
            "{}",
            told.scans.len()
        );
    }
    for length in [0, 5, 13, 100, 4095] {
        fs::write(&path, &whole[..length]).unwrap();
        says(&error_of(cut.clone()), &["cut.bag", "byte "]);
        says(&error_of(Config { allow_truncated: true, ..cut.clone() }), &["cut.bag"]);
    }
}

#[test]
fn a_damaged_chunk_of_a_bag_is_refused_with_its_place() {
    // bz2 has checksums. The lz4 frames of this bag have none: only damage to their structure can be seen.
    let frame_mark = [0x04, 0x22, 0x4d, 0x18];
    for file in ["simulated/bags/hall_first_6s_bz2.bag", "simulated/bags/hall_first_2s_lz4.bag"] {
        let Some(config) = bag(file) else { return };
        let mut bytes = fs::read(config.bag.clone().unwrap()).unwrap();
        let last_frame = bytes.windows(4).rposition(|window| window == frame_mark);
        let at = last_frame.filter(|_| file.contains("lz4")).unwrap_or(bytes.len() / 2);
        bytes[at..at + 64].fill(0xa5);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("damaged.bag");
        fs::write(&path, bytes).unwrap();
        says(
            &error_of(Config { bag: Some(path), ..config }),
            &["damaged.bag", "byte ", "chunk", "copy it again"],
        );
    }
}

#[test]
fn topics_that_a_bag_does_not_have_are_answered_with_those_it_has() {
    let Some(config) = bag("simulated/bags/hall_first_2s_lz4.bag") else { return };
    let wrong = Config { lidar_topic: Some("/velodyne".to_owned()), ..config.clone() };
    says(&error_of(wrong), &["/velodyne", "/livox/lidar", "lidar_topic"]);
    let wrong = Config { imu_topic: Some("/livox/lidar".to_owned()), ..config };
    says(&error_of(wrong), &["/livox/lidar", "/livox/imu", "imu_topic"]);
}

#[test]
fn the_real_walks_cut_in_the_middle_are_refused() {
    let (Some(good), Some(lidar)) = (walk("shake"), evac_testkit::unpacked("simulated/shake/lidar.pcap"))
    else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("half.pcap");
    let bytes = fs::read(lidar).unwrap();
    fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    says(
        &error_of(Config { lidar: Some(path), ..good.clone() }),
        &["half.pcap", "byte 14", "inside a packet"],
    );
    assert_eq!(open(good).total_scans(), Some(213));
}

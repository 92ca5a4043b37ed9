//! Recordings with arbitrary damage: an error or a replay, but no panic, no hang, and events in order.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::fs;

use common::bag::{Bag, F64, cloud, custom};
use evac_formats::livox_sdk1::{CartesianMm, DataFields, encode_cartesian, encode_imu};
use evac_formats::pcap::PcapWriter;
use evac_formats::wt901c::{encode_accel, encode_gyro, encode_time};
use evac_replay::{Config, Replay};
use evac_stage::{Rig, SensorEvent, Source};
use proptest::prelude::*;
use proptest::sample::Index;

const START: i64 = 1_700_000_000_000_000_000;

type Damage = Vec<(Index, u8)>;

fn damage() -> impl Strategy<Value = (Damage, Option<Index>)> {
    (proptest::collection::vec((any::<Index>(), any::<u8>()), 0..12), proptest::option::of(any::<Index>()))
}

fn apply(mut bytes: Vec<u8>, (changes, cut): &(Damage, Option<Index>)) -> Vec<u8> {
    for (at, value) in changes {
        let at = at.index(bytes.len());
        bytes[at] = *value;
    }
    if let Some(cut) = cut {
        bytes.truncate(cut.index(bytes.len()));
    }
    bytes
}

/// 300 ms of packets of five shots, with IMU packets.
fn capture() -> Vec<u8> {
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    let (shots, mut payload) = ([CartesianMm { position: [2000, 1, -1], reflectivity: 3 }; 5], Vec::new());
    let (lidar, host) = ("10.0.0.1:65000".parse().unwrap(), "10.0.0.2:56001".parse().unwrap());
    for packet in 0..75_u64 {
        let stamp = packet * 4_000_000;
        encode_cartesian(stamp, &shots, &mut payload);
        writer.write_udp(stamp as i64, lidar, host, &payload).unwrap();
        encode_imu(&DataFields::power_on(stamp + 1), [0.0; 3], [0.0, 0.0, 1.0], &mut payload);
        writer.write_udp(stamp as i64, lidar, host, &payload).unwrap();
    }
    writer.finish().unwrap()
}

fn log() -> Vec<u8> {
    let sample = |k: i64| {
        let time = encode_time(START + k * 5_000_000).unwrap();
        [time, encode_accel([0, 0, 2048], 0), encode_gyro([1, 2, 3], 0)].concat()
    };
    (0..60).flat_map(sample).collect()
}

fn bag() -> Vec<u8> {
    let mut bag = Bag::new();
    for k in 0..3 {
        let start = START + k * 100_000_000;
        bag.push("/livox/lidar", "livox_ros_driver/CustomMsg", custom(start, &[(0, 1.0), (99_000_000, 2.0)]));
        let times = [start as f64, start as f64 + 9e7];
        bag.push("/points", "sensor_msgs/PointCloud2", cloud(start, &times, Some(("timestamp", F64))));
    }
    bag.push_imu(START, 0.3, 9.8);
    bag.bytes()
}

/// Replays to the end or the first error; how many scans there were.
fn replay(config: Config) -> u64 {
    let Ok(mut replay) = Replay::new(config, &Rig::default()) else { return 0 };
    let (mut time, mut events, mut scans) = (i64::MIN, 0, 0);
    while let Ok(Some(event)) = replay.next_event() {
        let at = match event {
            SensorEvent::Imu(sample) => {
                assert!(sample.gyro.iter().chain(&sample.accel).all(|value| value.is_finite()));
                sample.stamp_ns
            }
            SensorEvent::Scan(header) => {
                assert!(header.frame.end_ns >= header.frame.start_ns);
                assert!((0..header.points as usize).all(|index| replay.point(index).is_finite()));
                scans += 1;
                header.frame.end_ns
            }
        };
        assert!(at >= time, "events go back from {time} to {at}");
        time = at;
        events += 1;
        assert!(events < 1_000_000, "it never ends");
    }
    scans
}

#[test]
fn the_undamaged_bytes_are_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let [lidar, imu, walk] = [("lidar", capture()), ("imu", log()), ("bag", bag())].map(|(name, bytes)| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        Some(path)
    });
    let own_imu = Config { lidar, ..Config::default() };
    assert_eq!(replay(own_imu.clone()), 3);
    assert_eq!(replay(Config { imu, ..own_imu }), 3);
    let custom = Config { bag: walk, ..Config::default() };
    assert_eq!(replay(custom.clone()), 3);
    assert_eq!(replay(Config { lidar_topic: Some("/points".to_owned()), ..custom }), 3);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn captures_and_logs(lidar in damage(), imu in damage(), own_imu in any::<bool>(), allow_truncated in any::<bool>()) {
        let folder = tempfile::tempdir().unwrap();
        let (lidar_path, imu_path) = (folder.path().join("lidar.pcap"), folder.path().join("imu.bin"));
        fs::write(&lidar_path, apply(capture(), &lidar)).unwrap();
        fs::write(&imu_path, apply(log(), &imu)).unwrap();
        let imu = (!own_imu).then_some(imu_path);
        replay(Config { lidar: Some(lidar_path), imu, allow_truncated, ..Config::default() });
    }

    #[test]
    fn bags(damage in damage(), as_cloud in any::<bool>(), allow_truncated in any::<bool>()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("walk.bag");
        fs::write(&path, apply(bag(), &damage)).unwrap();
        let lidar_topic = as_cloud.then(|| "/points".to_owned());
        replay(Config { bag: Some(path), lidar_topic, allow_truncated, ..Config::default() });
    }
}

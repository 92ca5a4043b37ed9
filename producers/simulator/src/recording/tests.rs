use evac_formats::livox_sdk1::Datagram;
use evac_formats::pcap::PcapReader;
use evac_formats::wt901c::{Scales, Wt901cReader};
use evac_frames::ImuSample;
use evac_stage::{SensorEvent, Source as _};

use crate::config::Config;
use crate::source::Simulator;

use super::*;

fn record(folder: &Path, rig: &Rig) -> (Vec<Vec<Point>>, Vec<ImuSample>, Vec<PoseFrame>) {
    let config =
        Config { seed: 3, duration_s: Some(4.0), record: Some(folder.to_owned()), ..Config::default() };
    let mut simulator = Simulator::new(config, rig).unwrap();
    let (mut scans, mut imu, mut truth) = (Vec::new(), Vec::new(), Vec::new());
    while let Some(event) = simulator.next_event().unwrap() {
        match event {
            SensorEvent::Imu(sample) => imu.push(sample),
            SensorEvent::Scan(header) => {
                truth.extend(simulator.truth());
                scans.push((0..header.points as usize).map(|index| simulator.point(index)).collect());
            }
        }
    }
    (scans, imu, truth)
}

#[test]
fn a_recording_holds_the_same_points_samples_and_poses_that_were_published() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = Rig::default();
    rig.imu_from_lidar.translation_m = [0.05, -0.02, 0.06];
    let (scans, imu, truth) = record(folder.path(), &rig);
    assert_eq!((scans.len(), imu.len(), truth.len()), (40, 801, 40));

    let mut capture = PcapReader::open(&folder.path().join("lidar.pcap")).unwrap();
    for (seq, scan) in scans.iter().enumerate() {
        for (packet, points) in scan.chunks(100).enumerate() {
            let udp = capture.next_datagram().unwrap().unwrap();
            let datagram = Datagram::parse(udp.payload).unwrap();
            let stamp_ns = (seq * 100 + packet) as i64 * 1_000_000;
            assert_eq!((datagram.header.stamp_ns, datagram.points()), (stamp_ns, 100));
            for (index, point) in points.iter().enumerate() {
                let read = datagram.point(index).unwrap();
                assert_eq!(
                    (read.position, read.reflectivity),
                    ([point.x, point.y, point.z], point.reflectivity())
                );
            }
        }
    }
    assert!(capture.next_datagram().unwrap().is_none());

    let mut log = Wt901cReader::open(&folder.path().join("wt901c.bin")).unwrap();
    for sample in &imu {
        let raw = log.next_sample().unwrap().unwrap();
        assert_eq!(Scales::default().accel(raw.accel), sample.accel);
        assert_eq!(Scales::default().gyro(raw.gyro), sample.gyro);
    }
    assert!(log.next_sample().unwrap().is_none());

    let poses = tum::read(&folder.path().join("truth.tum")).unwrap();
    assert_eq!(poses.len(), truth.len());
    for (pose, truth) in poses.iter().zip(&truth) {
        assert_eq!(pose.stamp_ns, truth.frame.end_ns);
        for (a, b) in pose.position.iter().zip(&truth.position) {
            assert!((a - b).abs() < 1e-9);
        }
    }

    let text = fs::read_to_string(folder.path().join("rig.toml")).unwrap();
    let table: toml::Table = text.parse().unwrap();
    let read: Rig = table["rig"].clone().try_into().unwrap();
    assert_eq!(read, rig);
}

#[test]
fn two_recordings_of_one_seed_are_equal_byte_for_byte() {
    let (first, second) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    record(first.path(), &Rig::default());
    record(second.path(), &Rig::default());
    for name in [Recording::LIDAR, Recording::IMU, Recording::TRUTH, Recording::RIG] {
        let read = |folder: &tempfile::TempDir| fs::read(folder.path().join(name)).unwrap();
        assert!(read(&first) == read(&second), "{name} differs");
    }
}

#[test]
fn a_folder_that_cannot_be_made_is_named_in_the_error() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let error = Recording::create(&file.path().join("walk"), &Rig::default()).unwrap_err().to_string();
    assert!(error.contains("walk"), "{error}");
}

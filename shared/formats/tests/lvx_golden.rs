//! LVX recordings of the maker's own sample, and damage to them.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::sync::LazyLock;

use evac_formats::livox_sdk1::{self, DataType};
use evac_formats::livox_sdk2;
use evac_formats::lvx::{LvxReader, Version};
use proptest::prelude::*;
use serde_json::Value;

use common::damaged;

fn golden(name: &str) -> Option<(std::path::PathBuf, Value)> {
    let folder = evac_testkit::data("protocols/lvx")?;
    let json = folder.join(name).with_extension("json");
    Some((folder.join(name), serde_json::from_slice(&fs::read(json).unwrap()).unwrap()))
}

#[test]
fn official_recordings_of_version_1_1_have_the_listed_packets_in_every_frame() {
    for name in ["mid40_1s_official_sample.lvx", "avia_3frames_official_sample_prefix.lvx"] {
        let Some((path, golden)) = golden(name) else { return };
        let mut reader = LvxReader::open(&path).unwrap();
        assert_eq!(reader.version(), Version::V1_1);
        let (device, expected) = (&reader.devices()[0], &golden["devices"][0]);
        assert_eq!(device.code, expected["code"].as_str().unwrap());
        assert_eq!((u64::from(device.id), u64::from(device.kind)), (0, expected["type"].as_u64().unwrap()));
        let extrinsic = device.extrinsic.unwrap();
        assert_eq!((extrinsic[2], extrinsic[5]), (90.0, expected["xyz_m"][2].as_f64().unwrap() as f32));
        // Number of packets by type, first and last time of each frame.
        let mut frames: Vec<(BTreeMap<u8, u64>, i64, i64)> = Vec::new();
        let mut first_imu = None;
        while let Some(packet) = reader.next_packet().unwrap() {
            let datagram = livox_sdk1::Datagram::parse(packet.datagram).unwrap();
            let (frame, stamp) = ((packet.time_ns / 50_000_000) as usize, datagram.header.stamp_ns);
            frames.resize(frames.len().max(frame + 1), (BTreeMap::new(), stamp, stamp));
            *frames[frame].0.entry(datagram.header.data_type as u8).or_default() += 1;
            frames[frame].2 = stamp;
            if datagram.header.data_type == DataType::Imu && first_imu.is_none() {
                first_imu = datagram.imu(0);
            }
        }
        let expected = golden["frames"].as_array().unwrap();
        assert_eq!(frames.len(), expected.len());
        for ((counts, first, last), expected) in frames.iter().zip(expected) {
            let listed = expected["by_data_type"].as_object().unwrap();
            let listed = listed.iter().map(|(kind, count)| (kind.parse().unwrap(), count.as_u64().unwrap()));
            assert_eq!(*counts, listed.collect::<BTreeMap<u8, u64>>());
            let times = [*first, *last].map(|time| time as u64);
            assert_eq!(times, ["first_ts", "last_ts"].map(|name| expected[name].as_u64().unwrap()));
        }
        if let Some(values) = golden["first_imu"]["values"].as_array() {
            let imu = first_imu.unwrap();
            let values: Vec<_> = values.iter().map(|value| value.as_f64().unwrap() as f32).collect();
            assert_eq!([imu.gyro, imu.accel_g].concat(), values);
        }
    }
}

/// The values of a packet as they stand in the file, rebuilt from what was read.
fn values_of(datagram: &livox_sdk1::Datagram<'_>) -> Vec<String> {
    if let Some(imu) = datagram.imu(0) {
        return [imu.gyro, imu.accel_g]
            .concat()
            .iter()
            .map(|value| format!("{}", f64::from(*value)))
            .collect();
    }
    let tagged = datagram.header.data_type != DataType::Cartesian;
    let points = (0..datagram.points()).map(|index| datagram.point(index).unwrap());
    points
        .flat_map(|point| {
            let mm = point.position.map(|metres| (f64::from(metres) * 1e3).round() as i64);
            let [reflectivity, tag] = [point.reflectivity, point.tag].map(i64::from);
            let tag = tagged.then_some(tag);
            mm.into_iter().chain([reflectivity]).chain(tag).map(|value| value.to_string())
        })
        .collect()
}

#[test]
fn every_value_of_version_1_1_is_what_another_decoder_reads() {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/lvx/decode.py");
    for (name, lines) in
        [("mid40_1s_official_sample.lvx", 1000), ("avia_3frames_official_sample_prefix.lvx", 150)]
    {
        let Some(path) = evac_testkit::data(&format!("protocols/lvx/{name}")) else { return };
        let output = match std::process::Command::new("python3").arg(script).arg(&path).output() {
            Ok(output) => output,
            Err(cause) => return println!("skipped: python3: {cause}"),
        };
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap();
        let (mut theirs, mut packets) = (text.lines(), 0);
        let mut reader = LvxReader::open(&path).unwrap();
        while let Some(packet) = reader.next_packet().unwrap() {
            let datagram = livox_sdk1::Datagram::parse(packet.datagram).unwrap();
            let mut expected = theirs.next().unwrap().split(' ');
            assert_eq!(expected.next(), Some(datagram.header.stamp_ns.to_string().as_str()));
            assert_eq!(expected.next(), Some((datagram.header.data_type as u8).to_string().as_str()));
            let (ours, theirs): (Vec<_>, Vec<_>) = (values_of(&datagram), expected.collect());
            let is_same = |(ours, theirs): (&String, &&str)| ours.parse::<f64>() == theirs.parse::<f64>();
            assert!(
                ours.len() == theirs.len() && ours.iter().zip(&theirs).all(is_same),
                "{name}, packet {packets}"
            );
            packets += 1;
        }
        assert!(theirs.next().is_none() && packets >= lines, "{name}: {packets} packets");
    }
}

#[test]
fn floats_of_version_1_0_are_the_millimetres_that_the_device_sent() {
    let Some(path) = evac_testkit::data("protocols/lvx/v1_0_own_2frames.lvx") else { return };
    let bytes = fs::read(&path).unwrap();
    let mut reader = LvxReader::open(&path).unwrap();
    assert_eq!(reader.version(), Version::V1_0);
    let mut packets = 0;
    while let Some(packet) = reader.next_packet().unwrap() {
        let datagram = livox_sdk1::Datagram::parse(packet.datagram).unwrap();
        assert_eq!(datagram.points(), 100);
        let records = &bytes[packet.offset as usize + 19..];
        for index in 0..100 {
            let point = datagram.point(index).unwrap();
            let float = |at: usize| {
                f32::from_le_bytes(records[13 * index + at..13 * index + at + 4].try_into().unwrap())
            };
            for (axis, value) in point.position.into_iter().enumerate() {
                assert!((value - float(4 * axis)).abs() < 6e-4, "{value} is not {}", float(4 * axis));
            }
            assert_eq!(point.reflectivity, records[13 * index + 12]);
        }
        packets += 1;
    }
    assert!(packets >= 2, "{packets} packets");
}

#[test]
fn packages_of_lvx2_are_the_datagrams_of_the_second_protocol() {
    let Some((path, golden)) = golden("own_3frames_lvx2.json") else { return };
    let mut reader = LvxReader::open(&path.with_file_name("own_3frames.lvx2")).unwrap();
    assert_eq!(reader.version(), Version::V2);
    let mut packets = 0;
    while let Some(packet) = reader.next_packet().unwrap() {
        let datagram = livox_sdk2::Datagram::parse_unchecked(packet.datagram).unwrap();
        assert_eq!(datagram.points(), 96);
        // The listed points are those of the first frame's two packages.
        if let Some(listed) = golden["points"].get(packets) {
            assert_eq!(datagram.header.data_type as u64, listed["data_type"].as_u64().unwrap());
            let unit = if listed["data_type"] == 1 { 1e-3 } else { 1e-2 };
            for expected in listed["points"].as_array().unwrap() {
                let point = datagram.point(expected["i"].as_u64().unwrap() as usize).unwrap();
                let position = ["x", "y", "z"].map(|axis| (expected[axis].as_f64().unwrap() * unit) as f32);
                for (value, expected) in point.position.iter().zip(position) {
                    assert!((value - expected).abs() < 1e-6);
                }
                assert_eq!(u64::from(point.reflectivity), expected["refl"].as_u64().unwrap());
                assert_eq!(u64::from(point.tag), expected["tag"].as_u64().unwrap());
            }
        }
        packets += 1;
    }
    assert_eq!(packets, 6);
}

/// One frame with two packets of version 1.1.
fn recording() -> Vec<u8> {
    let mut bytes = b"livox_tech\0\0\0\0\0\0\x01\x01\0\0\x67\xa7\x0e\xac".to_vec();
    bytes.extend(50_u32.to_le_bytes());
    bytes.push(1);
    bytes.extend([0; 59]);
    let start = bytes.len() as u64;
    let mut packets = Vec::new();
    for kind in [6_u8, 2] {
        packets.extend([0, 5, 1, 1, 0, 0, 0, 0, 0, 0, kind]);
        packets.extend([kind; 8]);
        packets.resize(packets.len() + if kind == 6 { 24 } else { 1344 }, 0);
    }
    bytes.extend(start.to_le_bytes());
    bytes.extend((start + 24 + packets.len() as u64).to_le_bytes());
    bytes.extend(0_u64.to_le_bytes());
    bytes.extend(packets);
    bytes
}

fn read(bytes: &[u8], tolerant: bool) -> Result<usize, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.lvx");
    fs::write(&path, bytes).unwrap();
    let mut reader = LvxReader::open(&path).map_err(|error| error.to_string())?.tolerate_truncation(tolerant);
    let mut packets = 0;
    while let Some(packet) = reader.next_packet().map_err(|error| error.to_string())? {
        let _ = livox_sdk1::Datagram::parse(packet.datagram);
        packets += 1;
    }
    Ok(packets)
}

#[test]
fn a_recording_that_was_cut_says_where_and_gives_its_whole_packets_on_request() {
    let whole = recording();
    assert_eq!(read(&whole, false), Ok(2));
    let cut = &whole[..whole.len() - 100];
    let said = read(cut, false).unwrap_err();
    assert!(said.contains("byte 88") && said.contains("--allow-truncated"), "{said}");
    assert_eq!(read(cut, true), Ok(1));
    let mut wrong = whole;
    wrong[88 + 24 + 1] = 9;
    assert!(read(&wrong, false).unwrap_err().contains("byte 112: the packet's version is 9"));
    assert!(read(b"livox_tech\0\0\0\0\0\0\x03\0\0\0\0\0\0\0", false).unwrap_err().contains("no LVX"));
}

static LVX2: LazyLock<Option<Vec<u8>>> =
    LazyLock::new(|| fs::read(evac_testkit::data("protocols/lvx/own_3frames.lvx2")?).ok());

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_recordings(
        first in damaged(recording()), second in damaged(LVX2.clone().unwrap_or_else(recording)), tolerant: bool
    ) {
        let _ = read(&first, tolerant);
        let _ = read(&second, tolerant);
    }
}

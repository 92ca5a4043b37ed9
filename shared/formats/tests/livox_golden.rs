//! Livox SDK1 datagrams and captures against values decoded by the vendor's own structs.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::collections::BTreeMap;

use common::{hex, json};
use evac_formats::livox_sdk1::{
    CartesianMm, DataFields, DataType, Datagram, DatagramError, PointRecord, Status, TimestampType,
    encode_cartesian, encode_imu, encode_points,
};
use evac_formats::pcap::PcapReader;
use serde_json::Value;

fn golden() -> Option<Value> {
    json("protocols/sdk1/data_packets.json")
}

/// Position of a golden point's echo (names end in 1, 2, 3 where a shot has several), metres.
fn position(point: &Value, echo: &str) -> Option<[f64; 3]> {
    let value = |name: &str| point[format!("{name}{echo}").as_str()].as_f64();
    if let Some(x) = value("x") {
        // The golden file leaves out y2 and z2 of triple echoes.
        return Some([x, value("y")?, value("z")?].map(|mm| mm * 1e-3));
    }
    let depth = value("depth")? * 1e-3;
    let angle = |name: &str| (point[name].as_f64().unwrap() * 0.01).to_radians();
    let (theta, phi) = (angle("theta"), angle("phi"));
    Some([depth * theta.sin() * phi.cos(), depth * theta.sin() * phi.sin(), depth * theta.cos()])
}

#[test]
fn every_data_type_is_decoded_as_by_the_vendor_s_structs() {
    let Some(golden) = golden() else { return };
    let mut echoes_seen = 0;
    for packet in golden["packets"].as_array().unwrap() {
        let bytes = hex(&packet["datagram_hex"]);
        let datagram = Datagram::parse(&bytes).unwrap();
        let header = datagram.header;
        assert_eq!(header.data_type as u64, packet["data_type"].as_u64().unwrap());
        assert_eq!(datagram.shots() as u64, packet["data_num"].as_u64().unwrap());
        assert_eq!(header.stamp_ns, packet["timestamp"].as_i64().unwrap());
        assert_eq!((header.slot, header.lidar_id, header.status), (1, 1, 0));
        assert_eq!(header.timestamp_type, TimestampType::PowerOn);
        let echoes = header.data_type.echoes();
        for point in packet["points"].as_array().unwrap() {
            let shot = point["i"].as_u64().unwrap() as usize;
            if header.data_type == DataType::Imu {
                let imu = datagram.imu(shot).unwrap();
                for (values, name) in [(imu.gyro, "gyro"), (imu.accel_g, "acc")] {
                    for (axis, value) in values.into_iter().enumerate() {
                        assert!((f64::from(value) - point[name][axis].as_f64().unwrap()).abs() < 1e-9);
                    }
                }
                assert_eq!(datagram.point(0), None);
                continue;
            }
            for echo in 0..echoes {
                let name = if echoes == 1 { String::new() } else { (echo + 1).to_string() };
                let Some(expected) = position(point, &name) else { continue };
                let decoded = datagram.point(shot * echoes + echo).unwrap();
                for (a, b) in decoded.position.into_iter().zip(expected) {
                    assert!(
                        (f64::from(a) - b).abs() < 1e-6,
                        "type {}: {a} is not {b}",
                        header.data_type as u8
                    );
                }
                let byte = |field: &str| point[format!("{field}{name}").as_str()].as_u64();
                assert_eq!(Some(u64::from(decoded.reflectivity)), byte("refl"));
                assert_eq!(u64::from(decoded.tag), byte("tag").unwrap_or(0));
                echoes_seen += 1;
            }
        }
        assert_eq!(datagram.point(datagram.points()), None);
        assert_eq!(datagram.imu(datagram.shots()), None);
    }
    assert!(echoes_seen >= 3 * (4 + 2 * 2 + 2 * 2), "only {echoes_seen} echoes were compared");
}

#[test]
fn every_kind_of_time_stamp_gives_the_vendor_s_nanoseconds() {
    let Some(golden) = golden() else { return };
    let cases = golden["timestamps"]["cases"].as_array().unwrap();
    for case in cases {
        let kind = TimestampType::from_wire(case["timestamp_type"].as_u64().unwrap() as u8).unwrap();
        let bytes: [u8; 8] = hex(&case["timestamp_hex"]).try_into().unwrap();
        assert_eq!(kind.nanoseconds(bytes), case["official_ns"].as_i64(), "{case}");
    }
    assert_eq!(cases.len(), 6);
    assert_eq!(TimestampType::Utc.nanoseconds([26, 13, 1, 0, 0, 0, 0, 0]), None);
    assert_eq!(TimestampType::Ptp.nanoseconds([0xff; 8]), None);
}

#[test]
fn encoded_datagrams_are_the_golden_ones_byte_for_byte() {
    let Some(golden) = golden() else { return };
    let (mut out, mut seen) = (Vec::new(), 0);
    for packet in golden["packets"].as_array().unwrap() {
        let bytes = hex(&packet["datagram_hex"]);
        let datagram = Datagram::parse(&bytes).unwrap();
        let stamp = datagram.header.stamp_ns as u64;
        let data_type = datagram.header.data_type;
        if data_type == DataType::Imu {
            let imu = datagram.imu(0).unwrap();
            encode_imu(&DataFields::power_on(stamp), imu.gyro, imu.accel_g, &mut out);
        } else {
            let records = bytes[18..].chunks_exact(data_type.record_bytes());
            let points: Vec<_> = records.flat_map(|record| raw_points(data_type, record)).collect();
            encode_points(data_type, &DataFields::power_on(stamp), &points, &mut out);
        }
        assert_eq!(out, bytes, "{data_type:?}");
        seen += 1;
        if data_type == DataType::Cartesian {
            let shots: Vec<_> = (0..datagram.points())
                .filter_map(|index| datagram.point(index))
                .map(|point| CartesianMm {
                    position: point.position.map(|m| (m * 1e3).round() as i32),
                    reflectivity: point.reflectivity,
                })
                .collect();
            encode_cartesian(stamp, &shots, &mut out);
            assert_eq!(out, bytes);
        }
    }
    assert_eq!(seen, 9);
}

/// The echoes of a record as they stand on the wire.
fn raw_points(data_type: DataType, record: &[u8]) -> Vec<PointRecord> {
    let number =
        |bytes: &[u8]| bytes.iter().rev().fold(0_u32, |value, byte| value << 8 | u32::from(*byte)) as i32;
    let tag = |bytes: &[u8]| bytes.first().copied().unwrap_or(0);
    let shared_angles = matches!(data_type, DataType::DualSpherical | DataType::TripleSpherical);
    let (angles, echoes) = record.split_at(if shared_angles { 4 } else { 0 });
    echoes
        .chunks_exact(echoes.len() / data_type.echoes())
        .map(|echo| match data_type {
            _ if shared_angles => PointRecord {
                values: [number(&echo[..4]), number(&angles[..2]), number(&angles[2..])],
                reflectivity: echo[4],
                tag: echo[5],
            },
            DataType::Spherical | DataType::ExtendedSpherical => PointRecord {
                values: [number(&echo[..4]), number(&echo[4..6]), number(&echo[6..8])],
                reflectivity: echo[8],
                tag: tag(&echo[9..]),
            },
            _ => PointRecord {
                values: [0, 4, 8].map(|at| number(&echo[at..at + 4])),
                reflectivity: echo[12],
                tag: tag(&echo[13..]),
            },
        })
        .collect()
}

#[test]
fn bytes_that_no_device_sends_are_refused_by_name() {
    let mut good = Vec::new();
    encode_cartesian(5, &[CartesianMm::default(); 3], &mut good);
    let changed = |at: usize, value: u8| {
        let mut bytes = good.clone();
        bytes[at] = value;
        Datagram::parse(&bytes).map(|datagram| datagram.shots())
    };
    assert_eq!(changed(2, 1), Ok(3));
    assert_eq!(changed(0, 0xaa), Err(DatagramError::Version(0xaa)));
    assert_eq!(changed(9, 9), Err(DatagramError::DataType(9)));
    assert_eq!(changed(8, 2), Err(DatagramError::TimestampType(2)));
    assert_eq!(changed(17, 0x80), Err(DatagramError::Stamp));
    assert_eq!(changed(8, 3), Err(DatagramError::Date));
    assert_eq!(changed(9, 1), Err(DatagramError::Remainder { record: 9, extra: 3 }));
    assert_eq!(Datagram::parse(&good[..17]).unwrap_err(), DatagramError::TooShort(17));
    assert_eq!(Datagram::parse(&good[..18]).unwrap_err(), DatagramError::TooShort(18));
}

#[test]
fn a_captured_session_has_the_datagrams_that_were_sent() {
    let Some(path) = evac_testkit::data("protocols/pcap/sdk1_mid40_session.pcap") else { return };
    let summary = std::fs::read(evac_testkit::data("protocols/pcap/summary.json").unwrap()).unwrap();
    let summary: Value = serde_json::from_slice(&summary).unwrap();
    let mut expected: BTreeMap<String, u64> = BTreeMap::new();
    for (line, count) in summary["sdk1_mid40_session.pcap"].as_object().unwrap() {
        let (route, _) = line.split_once(" control ").or_else(|| line.split_once(" data ")).unwrap();
        *expected.entry(route.to_owned()).or_default() += count.as_u64().unwrap();
    }
    let mut reader = PcapReader::open(&path).unwrap();
    let mut seen: BTreeMap<String, u64> = BTreeMap::new();
    let (mut data, mut last) = (0, i64::MIN);
    while let Some(udp) = reader.next_datagram().unwrap() {
        *seen.entry(format!("{} -> {}", udp.source, udp.destination)).or_default() += 1;
        if let Ok(datagram) = Datagram::parse(udp.payload) {
            assert_eq!((datagram.points(), udp.payload.len()), (100, 1318));
            data += 1;
        }
        assert!(udp.time_ns >= last);
        last = udp.time_ns;
    }
    assert_eq!(seen, expected);
    assert_eq!(data, 250);
}

#[test]
fn a_real_device_s_capture_gives_the_points_and_samples_that_its_description_counts() {
    let Some(path) = evac_testkit::data("real/livox_tele15_pcap/livox_tele15_small.pcap") else { return };
    let mut reader = PcapReader::open(&path).unwrap();
    let (mut points, mut returns, mut samples, mut gravity) = (0, 0, 0, 0.0);
    let mut tags: BTreeMap<u8, u64> = BTreeMap::new();
    while let Some(udp) = reader.next_datagram().unwrap() {
        let datagram = Datagram::parse(udp.payload).unwrap();
        assert_eq!(datagram.header.timestamp_type, TimestampType::Ptp);
        assert_eq!(
            Status(datagram.header.status).complaints().collect::<Vec<_>>(),
            ["dirty or blocked window", "fan warning", "system warning"]
        );
        for index in 0..datagram.points() {
            let point = datagram.point(index).unwrap();
            points += 1;
            returns += u64::from(point.position != [0.0; 3]);
            *tags.entry(point.tag).or_default() += 1;
        }
        if let Some(imu) = datagram.imu(0) {
            samples += 1;
            gravity += imu.accel_g.iter().map(|axis| axis * axis).sum::<f32>().sqrt();
        }
    }
    assert_eq!((points, returns, samples), (88_896, 88_844, 74));
    assert_eq!(tags, BTreeMap::from([(16, 88_632), (24, 264)]));
    assert!((gravity / 74.0 - 0.9937).abs() < 1e-3, "{gravity}");
}

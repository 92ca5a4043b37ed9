//! Livox SDK2 frames and datagrams against bytes that the vendor's own software made or took.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{hex, json};
use evac_formats::livox_sdk2::{
    DataFields, DataType, Datagram, DatagramError, Frame, FrameError, FrameKind, HostAddress, Parameters,
    ParametersWriter, PointRecord, SearchReply, Sender, TimeType, WriteReply, command, encode_imu,
    encode_points, key,
};
use evac_formats::pcap::PcapReader;
use serde_json::Value;

#[test]
fn every_control_frame_is_read_and_written_as_the_vendor_s_software_does() {
    let Some(golden) = json("protocols/sdk2/frames.json") else { return };
    let mut seen = 0;
    for case in golden["frames"].as_array().unwrap() {
        let bytes = hex(&case["frame_hex"]);
        let frame = Frame::parse(&bytes).unwrap();
        assert_eq!(u64::from(frame.sequence), case["seq"], "{case}");
        assert_eq!(u64::from(frame.command), case["cmd_id"], "{case}");
        assert_eq!(frame.kind as u64, case["cmd_type"], "{case}");
        assert_eq!(frame.sender as u64, case["sender"], "{case}");
        assert_eq!(frame.data, hex(&case["data_hex"]), "{case}");
        let mut out = Vec::new();
        frame.encode(&mut out);
        assert_eq!(out, bytes, "{case}");
        assert_eq!(written_again(&frame), frame.data, "{case}");
        seen += 1;
    }
    assert_eq!(seen, 32);
}

/// The data of a frame after being read into typed values and written from these.
fn written_again(frame: &Frame<'_>) -> Vec<u8> {
    let mut out = Vec::new();
    match (frame.command, frame.kind) {
        (command::SEARCH, FrameKind::Ack) => SearchReply::parse(frame.data).unwrap().encode(&mut out),
        (command::WRITE_PARAMETERS, FrameKind::Ack) => {
            out.extend(WriteReply::parse(frame.data).unwrap().to_bytes());
        }
        (command::WRITE_PARAMETERS | command::PUSH, FrameKind::Request) => {
            let list = Parameters::of_request(frame.data).unwrap();
            assert!(list.is_whole());
            let mut writer = ParametersWriter::request(&mut out);
            list.for_each(|parameter| writer.put(parameter.key, parameter.value));
        }
        (command::READ_PARAMETERS, FrameKind::Request) => {
            let keys: Vec<_> = Parameters::keys_of_query(frame.data).collect();
            ParametersWriter::query(&keys, &mut out);
        }
        (command::READ_PARAMETERS, FrameKind::Ack) => {
            let (code, list) = Parameters::of_answer(frame.data).unwrap();
            assert!(list.is_whole());
            let mut writer = ParametersWriter::answer(code, &mut out);
            list.for_each(|parameter| writer.put(parameter.key, parameter.value));
        }
        _ => out.extend_from_slice(frame.data),
    }
    out
}

#[test]
fn lists_hold_the_keys_and_values_that_the_vendor_decoded() {
    let Some(golden) = json("protocols/sdk2/frames.json") else { return };
    let mut seen = 0;
    for case in golden["frames"].as_array().unwrap() {
        let Some(expected) = case["decoded"].as_array() else { continue };
        let data = hex(&case["data_hex"]);
        let answer = case["cmd_id"] == u64::from(command::READ_PARAMETERS) && case["cmd_type"] == 1;
        let list = match answer {
            true => Parameters::of_answer(&data).unwrap().1,
            false => Parameters::of_request(&data).unwrap(),
        };
        let list: Vec<_> = list.collect();
        assert_eq!(list.len(), expected.len(), "{case}");
        for (parameter, expected) in list.iter().zip(expected) {
            assert_eq!(u64::from(parameter.key), expected["key"]);
            assert_eq!(parameter.value, hex(&expected["value_hex"]));
            seen += 1;
        }
    }
    assert!(seen > 80, "{seen}");
}

#[test]
fn damaged_control_frames_are_refused_as_by_the_vendor_s_parser() {
    let Some(golden) = json("protocols/sdk2/frames.json") else { return };
    let cases = golden["malformed"].as_array().unwrap();
    for case in cases {
        assert_eq!(case["official_parser"], "reject");
        assert!(Frame::parse(&hex(&case["frame_hex"])).is_err(), "{case}");
    }
    assert_eq!(cases.len(), 3);
}

/// Datagrams, as the golden file has them.
fn datagrams() -> Option<Vec<Value>> {
    Some(json("protocols/sdk2/data_packets.json")?["packets"].as_array().unwrap().clone())
}

#[test]
fn every_data_type_is_decoded_as_by_the_vendor_s_structs() {
    let Some(packets) = datagrams() else { return };
    for packet in &packets {
        let bytes = hex(&packet["datagram_hex"]);
        let datagram = Datagram::parse(&bytes).unwrap();
        let header = datagram.header;
        assert_eq!(header.data_type as u64, packet["data_type"]);
        assert_eq!(header.stamp_ns, packet["timestamp"].as_i64().unwrap());
        assert_eq!(header.interval_ns, packet["time_interval"].as_i64().unwrap() * 100);
        assert_eq!(u64::from(header.records), packet["dot_num"]);
        assert_eq!(u64::from(header.number), packet["udp_cnt"]);
        assert_eq!(u64::from(header.frame), packet["frame_cnt"]);
        assert_eq!(header.time_type, TimeType::PowerOn);
        for point in packet["points"].as_array().unwrap() {
            if header.data_type == DataType::Imu {
                let imu = datagram.imu(0).unwrap();
                for (values, name) in [(imu.gyro, "gyro"), (imu.accel_g, "acc")] {
                    for (axis, value) in values.into_iter().enumerate() {
                        assert!((f64::from(value) - point[name][axis].as_f64().unwrap()).abs() < 1e-9);
                    }
                }
                continue;
            }
            let decoded = datagram.point(point["i"].as_u64().unwrap() as usize).unwrap();
            for (a, b) in decoded.position.into_iter().zip(position(header.data_type, point)) {
                assert!((f64::from(a) - b).abs() < 1e-6, "{point}: {a} is not {b}");
            }
            assert_eq!(u64::from(decoded.reflectivity), point["refl"]);
            assert_eq!(u64::from(decoded.tag), point["tag"]);
        }
        assert_eq!(datagram.point(datagram.points()), None);
        assert_eq!(datagram.imu(1), None);
    }
    let types: Vec<_> = packets.iter().map(|packet| packet["data_type"].as_u64().unwrap()).collect();
    assert_eq!(types, [0, 1, 2, 3]);
}

/// Metres.
fn position(data_type: DataType, point: &Value) -> [f64; 3] {
    let value = |name: &str| point[name].as_f64().unwrap();
    if data_type == DataType::Spherical {
        let (theta, phi) = ((value("theta") * 0.01).to_radians(), (value("phi") * 0.01).to_radians());
        return [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
            .map(|share| share * value("depth") * 1e-3);
    }
    let unit = if data_type == DataType::Cartesian16 { 1e-2 } else { 1e-3 };
    ["x", "y", "z"].map(|axis| value(axis) * unit)
}

#[test]
fn encoded_datagrams_are_the_golden_ones_byte_for_byte() {
    let Some(packets) = datagrams() else { return };
    for packet in &packets {
        let bytes = hex(&packet["datagram_hex"]);
        let datagram = Datagram::parse(&bytes).unwrap();
        let header = datagram.header;
        let fields = DataFields {
            interval: (header.interval_ns / 100) as u16,
            number: header.number,
            frame: header.frame,
            time_type: header.time_type,
            stamp_ns: header.stamp_ns as u64,
        };
        let mut out = Vec::new();
        if header.data_type == DataType::Imu {
            let imu = datagram.imu(0).unwrap();
            encode_imu(&fields, imu.gyro, imu.accel_g, &mut out);
        } else {
            let raw = bytes[36..].chunks_exact(header.data_type.record_bytes());
            let points: Vec<_> = raw.map(|record| raw_point(header.data_type, record)).collect();
            encode_points(header.data_type, &fields, &points, &mut out);
        }
        assert_eq!(out, bytes);
    }
}

fn raw_point(data_type: DataType, record: &[u8]) -> PointRecord {
    let number = |range: std::ops::Range<usize>| {
        record[range].iter().rev().fold(0_i64, |value, byte| value << 8 | i64::from(*byte)) as i32
    };
    let values = match data_type {
        DataType::Cartesian16 => [0, 2, 4].map(|at| i32::from(number(at..at + 2) as i16)),
        DataType::Spherical => [number(0..4), number(4..6), number(6..8)],
        _ => [0, 4, 8].map(|at| number(at..at + 4)),
    };
    PointRecord { values, reflectivity: record[record.len() - 2], tag: record[record.len() - 1] }
}

const FIELDS: DataFields =
    DataFields { interval: 9500, number: 7, frame: 1, time_type: TimeType::Ptp, stamp_ns: 5_000_000_000 };

#[test]
fn two_echoes_of_a_shot_share_its_time() {
    let points = [1, 2, 3, 4].map(|x| PointRecord { values: [x * 1000, 0, -5], reflectivity: 9, tag: 3 });
    let mut bytes = Vec::new();
    encode_points(DataType::DualCartesian, &FIELDS, &points, &mut bytes);
    let datagram = Datagram::parse(&bytes).unwrap();
    assert_eq!((datagram.shots(), datagram.points(), bytes.len()), (2, 4, 36 + 56));
    let xs = [0, 1, 2, 3].map(|index| datagram.point(index).unwrap().position[0]);
    assert_eq!(xs, [1.0, 2.0, 3.0, 4.0]);
    assert_eq!([0, 1].map(|shot| datagram.shot_offset_ns(shot)), [0, 950_000]);
}

#[test]
fn bytes_that_no_device_sends_are_refused_by_name() {
    let mut good = Vec::new();
    encode_points(DataType::Cartesian16, &FIELDS, &[PointRecord::default(); 3], &mut good);
    let changed = |at: usize, value: u8| {
        let mut bytes = good.clone();
        bytes[at] = value;
        Datagram::parse(&bytes).map(|datagram| datagram.shots())
    };
    assert_eq!(changed(12, 0), Ok(3));
    assert_eq!(changed(0, 5), Err(DatagramError::Version(5)));
    assert_eq!(changed(1, 61), Err(DatagramError::Length { said: 61, have: 60 }));
    assert_eq!(changed(10, 4), Err(DatagramError::DataType(4)));
    assert_eq!(changed(11, 3), Err(DatagramError::TimeType(3)));
    assert_eq!(changed(35, 0x80), Err(DatagramError::Stamp));
    assert_eq!(changed(5, 4), Err(DatagramError::Records { records: 4, record: 8, have: 24 }));
    assert_eq!(changed(40, 1), Err(DatagramError::Checksum));
    assert_eq!(Datagram::parse(&good[..35]).unwrap_err(), DatagramError::TooShort(35));
}

#[test]
fn the_vendor_s_examples_hold_without_any_files() {
    let search = [0xaa, 0, 24, 0, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x6b, 0xe9, 0, 0, 0, 0];
    let frame = Frame::parse(&search).unwrap();
    let expected = Frame {
        sequence: 3,
        command: command::SEARCH,
        kind: FrameKind::Request,
        sender: Sender::Host,
        data: &[],
    };
    assert_eq!(frame, expected);
    let mut out = Vec::new();
    expected.encode(&mut out);
    assert_eq!(out, search);
    assert_eq!(Frame::parse(&search[..23]), Err(FrameError::TooShort { have: 23, needed: 24 }));

    let reply = hex(&Value::from(
        "aa00300003000000000001010000000000004841ba88ab4b000934374d444c3954303032303139330000c0a8010c24db",
    ));
    let frame = Frame::parse(&reply).unwrap();
    let found = SearchReply::parse(frame.data).unwrap();
    assert_eq!((found.device_type, found.command), (9, "192.168.1.12:56100".parse().unwrap()));
    assert!(found.serial.starts_with(b"47MDL9T0020193\0"));

    let address = HostAddress { host: "192.168.1.5:56301".parse().unwrap(), device_port: 56300 };
    assert_eq!(address.to_bytes(), [192, 168, 1, 5, 0xed, 0xdb, 0xec, 0xdb]);
    assert_eq!(HostAddress::parse(&address.to_bytes()), Some(address));
    let mut list = Vec::new();
    ParametersWriter::request(&mut list).put(key::WORK_TARGET, &[1]);
    assert_eq!(list, [1, 0, 0, 0, 0x1a, 0, 1, 0, 1]);
    assert!(!Parameters::of_request(&list[..8]).unwrap().is_whole());
}

#[test]
fn a_captured_session_has_only_frames_and_datagrams_of_this_protocol() {
    let Some(path) = evac_testkit::data("protocols/pcap/sdk2_mid360_session.pcap") else { return };
    let mut reader = PcapReader::open(&path).unwrap();
    let (mut points, mut imu, mut control) = (0, 0, 0);
    while let Some(udp) = reader.next_datagram().unwrap() {
        match udp.source.port() {
            56300 => {
                assert_eq!(Datagram::parse(udp.payload).unwrap().points(), 96);
                points += 1;
            }
            56400 => {
                assert!(Datagram::parse(udp.payload).unwrap().imu(0).is_some());
                imu += 1;
            }
            _ => {
                Frame::parse(udp.payload).unwrap();
                control += 1;
            }
        }
    }
    assert_eq!((points, imu, control), (250, 540, 6 + 4 + 2 + 2 + 4 + 4 + 3));
}

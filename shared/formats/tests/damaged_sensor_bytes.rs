//! No bytes whatsoever make a parser of sensor data panic, hang or take memory without bounds.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::path::Path;

use evac_formats::livox_sdk1::{
    CartesianMm, DataType, Datagram, Frame, FrameKind, Frames, Reply, Request, encode_cartesian,
};
use evac_formats::livox_sdk2;
use evac_formats::pcap::{PcapReader, PcapWriter};
use evac_formats::wt901c::modbus::{self, MAX_REGISTERS, MAX_REPLY_BYTES, ReplyParser, encode_reply};
use evac_formats::wt901c::{
    Command, CommandParser, Parser, Scales, Wt901cReader, encode_accel, encode_gyro, encode_time,
};
use proptest::prelude::*;

use common::damaged;

/// Reads everything that there is to read.
fn read_datagram(bytes: &[u8]) {
    let Ok(datagram) = Datagram::parse(bytes) else { return };
    for index in 0..=datagram.points() {
        assert_eq!(datagram.point(index).is_some(), index < datagram.points());
    }
    let samples = if datagram.header.data_type == DataType::Imu { datagram.shots() } else { 0 };
    for index in 0..=samples {
        assert_eq!(datagram.imu(index).is_some(), index < samples);
    }
    assert!(datagram.points() <= bytes.len());
}

/// Every byte belongs to a frame or is skipped, and what is read is written back as it was.
fn read_frames(bytes: &[u8]) {
    let mut frames = Frames::new(bytes);
    let (mut used, mut out) = (0, Vec::new());
    for frame in frames.by_ref() {
        frame.encode(&mut out);
        used += out.len();
        read_payload(frame.set, frame.id, frame.payload);
    }
    assert_eq!(used + frames.skipped(), bytes.len());
}

fn read_payload(set: u8, id: u8, payload: &[u8]) {
    let mut out = Vec::new();
    if let Some(request) = Request::read(set, id, payload) {
        assert_eq!(request.code(), (set, id));
        request.write(&mut out);
        assert_eq!(out, payload);
    }
    out.clear();
    if let Some(reply) = Reply::read(set, id, payload) {
        reply.write(&mut out);
        // Not-a-numbers keep their bits too.
        assert_eq!(out, payload);
    }
}

fn two_frames() -> Vec<u8> {
    let (mut all, mut one) = (vec![0xaa, 0, 0xaa], Vec::new());
    for (kind, id, payload) in
        [(FrameKind::Command, 1, &[9; 10][..]), (FrameKind::Ack, 3, &[0, 1, 0, 0, 0, 0, 0])]
    {
        Frame { kind, sequence: 7, set: 0, id, payload }.encode(&mut one);
        all.extend_from_slice(&one);
    }
    all
}

/// Reads everything that there is to read of the second protocol.
fn read_sdk2(bytes: &[u8]) {
    if let Ok(datagram) = livox_sdk2::Datagram::parse_unchecked(bytes) {
        for index in 0..=datagram.points() {
            assert_eq!(datagram.point(index).is_some(), index < datagram.points());
        }
        for index in 0..=datagram.shots() {
            let is_sample = datagram.points() == 0 && index < datagram.shots();
            assert_eq!(datagram.imu(index).is_some(), is_sample);
            let _ = datagram.shot_offset_ns(index);
        }
        assert!(datagram.points() <= bytes.len());
    }
    let data = livox_sdk2::Frame::parse(bytes).map_or(bytes, |frame| frame.data);
    for list in [
        livox_sdk2::Parameters::of_request(data),
        livox_sdk2::Parameters::of_answer(data).map(|(_, list)| list),
    ] {
        assert!(list.map_or(0, Iterator::count) <= bytes.len() / 4);
    }
    assert!(livox_sdk2::Parameters::keys_of_query(data).count() <= bytes.len() / 2);
    let _ = (livox_sdk2::SearchReply::parse(data), livox_sdk2::WriteReply::parse(data));
    let _ = livox_sdk2::HostAddress::parse(data);
}

fn sdk2_points() -> Vec<u8> {
    let fields = livox_sdk2::DataFields {
        interval: 9500,
        number: 1,
        frame: 2,
        time_type: livox_sdk2::TimeType::PowerOn,
        stamp_ns: 5,
    };
    let mut bytes = Vec::new();
    let points = [livox_sdk2::PointRecord { values: [1, -2, 3], reflectivity: 4, tag: 5 }; 8];
    livox_sdk2::encode_points(livox_sdk2::DataType::Spherical, &fields, &points, &mut bytes);
    bytes
}

fn sdk2_list() -> Vec<u8> {
    let (mut list, mut bytes) = (Vec::new(), Vec::new());
    let mut writer = livox_sdk2::ParametersWriter::request(&mut list);
    for key in 0..6 {
        writer.put(key, &[7; 5]);
    }
    let frame = livox_sdk2::Frame {
        sequence: 1,
        command: livox_sdk2::command::WRITE_PARAMETERS,
        kind: livox_sdk2::FrameKind::Request,
        sender: livox_sdk2::Sender::Host,
        data: &list,
    };
    frame.encode(&mut bytes);
    bytes
}

fn read_capture(bytes: &[u8], tolerant: bool) {
    let Ok(reader) = PcapReader::new(bytes, Path::new("a.pcap")) else { return };
    let mut reader = reader.tolerate_truncation(tolerant);
    while let Ok(Some(udp)) = reader.next_datagram() {
        read_datagram(udp.payload);
    }
}

fn read_log(bytes: &[u8], tolerant: bool) {
    let mut parser = Parser::default();
    let frames = bytes.iter().filter_map(|byte| parser.push(*byte));
    let readings: Vec<_> = frames.map(|frame| frame.reading(&Scales::default())).collect();
    let frames = readings.len();
    assert_eq!(frames * 11 + parser.pending() + parser.skipped() as usize, bytes.len());
    let mut reader = Wt901cReader::new(bytes, Path::new("a.bin")).tolerate_truncation(tolerant);
    while let Ok(Some(_)) = reader.next_sample() {}
}

fn a_datagram() -> Vec<u8> {
    let mut bytes = Vec::new();
    encode_cartesian(1_000_000, &[CartesianMm { position: [1, -2, 3], reflectivity: 4 }; 8], &mut bytes);
    bytes
}

fn a_capture() -> Vec<u8> {
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    for time in 0..4 {
        let (source, host) = ("10.0.0.1:65000".parse().unwrap(), "10.0.0.2:56001".parse().unwrap());
        writer.write_udp(time, source, host, &a_datagram()).unwrap();
    }
    writer.finish().unwrap()
}

fn a_log() -> Vec<u8> {
    let sample = |k: i16| {
        [
            encode_time(i64::from(k) * 5_000_000 + 1_700_000_000_000_000_000).unwrap(),
            encode_accel([k, 0x5551, 2048], 2500),
            encode_gyro([k, 0x5552, 0], 500),
        ]
        .concat()
    };
    (0..20).flat_map(sample).collect()
}

#[test]
fn the_undamaged_bytes_are_accepted() {
    assert_eq!(Datagram::parse(&a_datagram()).unwrap().points(), 8);
    assert_eq!(Frames::new(&two_frames()).count(), 2);
    assert!(
        livox_sdk2::Datagram::parse(&sdk2_points()).is_ok() && livox_sdk2::Frame::parse(&sdk2_list()).is_ok()
    );
    let bytes = a_capture();
    let mut capture = PcapReader::new(bytes.as_slice(), Path::new("a.pcap")).unwrap();
    while capture.next_datagram().unwrap().is_some() {}
    assert_eq!(capture.counts().datagrams, 4);
    let bytes = a_log();
    let mut log = Wt901cReader::new(bytes.as_slice(), Path::new("a.bin"));
    while log.next_sample().unwrap().is_some() {}
    assert_eq!(log.counts().samples, 20);
}

/// Bytes as they come to a module, or from one on RS485.
fn read_commands(bytes: &[u8], registers: usize) {
    let mut commands = CommandParser::default();
    let found = bytes.iter().filter_map(|byte| commands.push(*byte)).count();
    assert!(found * 5 <= bytes.len());
    let mut replies = ReplyParser::new(0x50, registers);
    let found = bytes.iter().filter_map(|byte| replies.push(*byte)).count();
    assert!(found * (5 + 2 * registers.min(MAX_REGISTERS)) + replies.skipped() as usize <= bytes.len());
    for window in bytes.windows(8) {
        let window: [u8; 8] = window.try_into().unwrap();
        if let Some(request) = modbus::Request::parse(&window, 0x50) {
            assert_eq!(request.bytes(0x50), window);
        }
    }
}

fn some_commands() -> Vec<u8> {
    let mut bytes = Command::UNLOCK.bytes().to_vec();
    bytes.extend(Command::read(0x34).bytes());
    bytes.extend(modbus::Request::Read { first: 0x34, count: 6 }.bytes(0x50));
    let mut reply = [0; MAX_REPLY_BYTES];
    let length = encode_reply(0x50, &[1, 2, 3, 4, 5, 6], &mut reply).unwrap();
    bytes.extend(&reply[..length]);
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn livox_datagrams(bytes in damaged(a_datagram()), noise in proptest::collection::vec(any::<u8>(), 0..200)) {
        read_datagram(&bytes);
        read_datagram(&noise);
        read_datagram(&[&[5, 1, 1, 0, 0, 0, 0, 0], noise.as_slice()].concat());
    }

    #[test]
    fn sdk1_frames(bytes in damaged(two_frames()), noise in proptest::collection::vec(any::<u8>(), 0..40), set in 0..3_u8, id in 0..16_u8) {
        read_frames(&bytes);
        read_frames(&noise);
        read_payload(set, id, &noise);
    }

    #[test]
    fn sdk2_datagrams_and_lists(
        points in damaged(sdk2_points()),
        list in damaged(sdk2_list()),
        noise in proptest::collection::vec(any::<u8>(), 0..200),
    ) {
        read_sdk2(&points);
        read_sdk2(&list);
        read_sdk2(list.get(24..).unwrap_or_default());
        read_sdk2(&noise);
    }

    #[test]
    fn captures(bytes in damaged(a_capture()), tolerant in any::<bool>()) {
        read_capture(&bytes, tolerant);
    }

    #[test]
    fn wt901c_streams(bytes in damaged(a_log()), tolerant in any::<bool>()) {
        read_log(&bytes, tolerant);
    }

    #[test]
    fn noise_is_no_wt901c_stream(bytes in proptest::collection::vec(prop_oneof![Just(0x55_u8), Just(0x51), any::<u8>()], 0..400)) {
        read_log(&bytes, true);
    }

    #[test]
    fn wt901c_commands_and_modbus(
        bytes in damaged(some_commands()),
        noise in proptest::collection::vec(prop_oneof![Just(0x50_u8), Just(0x03), any::<u8>()], 0..200),
        registers in 0..20_usize,
    ) {
        read_commands(&bytes, 6);
        read_commands(&noise, registers);
    }
}

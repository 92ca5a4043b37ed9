//! Livox SDK1 control frames against bytes that the vendor's own software and real devices sent.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{hex, json};
use evac_formats::livox_sdk1::{
    Extrinsic, Frame, FrameKind, Frames, Reply, Request, ReturnMode, Status, UtcTime, WorkState,
};
use serde_json::Value;

/// The frame of some bytes, which are that frame and nothing else, and are written the same.
fn only_frame(bytes: &[u8]) -> Frame<'_> {
    let mut frames = Frames::new(bytes);
    let frame = frames.next().unwrap();
    assert!(frames.next().is_none() && frames.skipped() == 0);
    let mut out = Vec::new();
    frame.encode(&mut out);
    assert_eq!(out, bytes);
    frame
}

/// The payload after being read as a typed value and written from it.
fn written_again(frame: &Frame<'_>, from_device: bool) -> Vec<u8> {
    let mut out = Vec::new();
    if from_device {
        Reply::read(frame.set, frame.id, frame.payload).unwrap().write(&mut out);
    } else {
        let request = Request::read(frame.set, frame.id, frame.payload).unwrap();
        assert_eq!(request.code(), (frame.set, frame.id));
        request.write(&mut out);
    }
    out
}

fn same_fields(frame: &Frame<'_>, case: &Value) {
    assert_eq!(frame.kind as u64, case["cmd_type"], "{case}");
    assert_eq!(u64::from(frame.sequence), case["seq"], "{case}");
    assert_eq!(u64::from(frame.set), case["cmd_set"], "{case}");
    assert_eq!(u64::from(frame.id), case["cmd_id"], "{case}");
}

#[test]
fn every_frame_of_the_vendor_s_sessions_is_read_and_written_byte_for_byte() {
    let Some(golden) = json("protocols/sdk1/frames.json") else { return };
    let cases = golden["frames"].as_array().unwrap();
    for case in cases {
        let bytes = hex(&case["frame_hex"]);
        let frame = only_frame(&bytes);
        same_fields(&frame, case);
        assert_eq!(frame.payload, hex(&case["data_hex"]), "{case}");
        assert_eq!(written_again(&frame, case["direction"] == "lidar->host"), frame.payload, "{case}");
    }
    assert_eq!(cases.len(), 64);
}

#[test]
fn frames_seen_in_the_field_are_read_and_written_byte_for_byte() {
    let Some(golden) = json("protocols/sdk1/field_frames.json") else { return };
    let cases = golden.as_array().unwrap();
    for case in cases {
        let bytes = hex(&case["frame_hex"]);
        let frame = only_frame(&bytes);
        same_fields(&frame, case);
        assert_eq!(frame.payload, hex(&case["data"]), "{case}");
        assert_eq!(written_again(&frame, frame.kind == FrameKind::Ack), frame.payload, "{case}");
    }
    assert_eq!(cases.len(), 20);
}

#[test]
fn damaged_frames_are_skipped_as_by_the_vendor_s_parser() {
    let Some(golden) = json("protocols/sdk1/frames.json") else { return };
    for case in golden["malformed"].as_array().unwrap() {
        let expected = case["official_parser"].as_str().unwrap();
        let frames: Vec<_> = expected.lines().filter(|line| line.starts_with("ok ")).collect();
        let bytes = hex(&case["frame_hex"]);
        let read: Vec<_> = Frames::new(&bytes)
            .map(|frame| {
                let (set, id, length) = (frame.set, frame.id, frame.payload.len());
                format!("ok type={} seq={} set={set} id={id} len={length}", frame.kind as u8, frame.sequence)
            })
            .collect();
        assert_eq!(read, frames, "{case}");
    }
}

#[test]
fn values_inside_payloads_are_those_of_the_vendor_s_document_without_any_files() {
    let bytes = hex(&Value::from("aa011900010200b0310001c0a80105c1dacdd8c1daf45d01b0"));
    let frame = only_frame(&bytes);
    let handshake = Request::Handshake {
        host: [192, 168, 1, 5],
        data_port: 56001,
        command_port: 55501,
        imu_port: Some(56001),
    };
    assert_eq!(Request::read(frame.set, frame.id, frame.payload), Some(handshake));

    let bytes = hex(&Value::from("aa012200020000597e00003054464447334230303648325a31310001000034ab3f89"));
    let frame = only_frame(&bytes);
    let Some(Reply::Broadcast(broadcast)) = Reply::read(frame.set, frame.id, frame.payload) else { panic!() };
    assert_eq!((broadcast.code_text(), broadcast.device_type), ("0TFDG3B006H2Z11", 1));

    let bytes = hex(&Value::from("aa01160001050044160003000000 04000000c1463acb".replace(' ', "")));
    let frame = only_frame(&bytes);
    let starting =
        Reply::Heartbeat { code: 0, state: Ok(WorkState::Initialising), features: 0, progress_or_status: 4 };
    assert_eq!(Reply::read(frame.set, frame.id, frame.payload), Some(starting));

    let extrinsic = Extrinsic { roll_pitch_yaw_deg: [1.5, -2.5, 180.0], translation_mm: [100, -200, 300] };
    let mut payload = Vec::new();
    Request::WriteExtrinsic(extrinsic).write(&mut payload);
    assert_eq!(payload, hex(&Value::from("0000c03f000020c0000034436400000038ffffff2c010000")));
    let time = UtcTime { year: 26, month: 11, day: 21, hour: 14, microseconds: 15_000_000 };
    assert_eq!(time.to_bytes().to_vec(), hex(&Value::from("1a0b150ec0e1e400")));
    assert_eq!(UtcTime::from_bytes(time.to_bytes()), time);
    assert_eq!(UtcTime::of_nanoseconds(1_795_269_615_000_000_999), time);
    assert_eq!(Request::read(1, 6, &[3]), Some(Request::SetReturnMode(ReturnMode::Triple)));
    for (set, id, payload) in [(1, 6, &[4][..]), (0, 4, &[2]), (0, 3, &[0]), (0, 1, &[0; 9]), (2, 0, &[])] {
        assert_eq!(Request::read(set, id, payload), None);
    }
}

#[test]
fn a_status_word_says_in_words_what_is_wrong() {
    assert_eq!(Status(1 << 9 | 1 << 13 | 1 << 14).complaints().count(), 0, "pulse and PTP are no complaints");
    let words = |status: u32| Status(status).complaints().collect::<Vec<_>>();
    assert_eq!(words(0x2), ["temperature extreme"]);
    assert_eq!(words(0x10 | 2 << 30), ["motor warning", "system error"]);
    assert!(Status(2 << 30).is_error() && !Status(1 << 30).is_error());
}

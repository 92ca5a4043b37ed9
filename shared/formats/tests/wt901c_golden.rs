//! The WT901C's byte stream against streams parsed by the vendor's own parser.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use evac_formats::wt901c::{Parser, Wt901cReader, encode_accel, encode_gyro, encode_time, id};
use serde_json::Value;

fn bytes(name: &str) -> Option<Vec<u8>> {
    Some(std::fs::read(evac_testkit::data(&format!("protocols/wt901c/{name}"))?).unwrap())
}

fn triple(value: &Value) -> [i16; 3] {
    [0, 1, 2].map(|axis| value[axis].as_i64().unwrap() as i16)
}

#[test]
fn the_damaged_stream_gives_the_vendor_parser_s_frames_and_no_other() {
    let (Some(stream), Some(golden)) =
        (bytes("wt901c_200hz_10s_corrupt.bin"), bytes("wt901c_200hz_10s_corrupt.decoded.json"))
    else {
        return;
    };
    let golden: Value = serde_json::from_slice(&golden).unwrap();
    let mut parser = Parser::default();
    let frames: Vec<_> = stream.iter().filter_map(|byte| parser.push(*byte)).collect();
    let expected = golden["frames"].as_array().unwrap();
    assert_eq!(frames.len(), expected.len());
    for (frame, expected) in frames.iter().zip(expected) {
        assert_eq!(frame.offset, expected["offset"].as_u64().unwrap());
        assert_eq!(u64::from(frame.id), expected["id"].as_u64().unwrap());
        let words: Vec<i64> =
            expected["words"].as_array().unwrap().iter().map(|w| w.as_i64().unwrap()).collect();
        assert_eq!(frame.words().map(i64::from).as_slice(), words);
    }
    assert_eq!(frames.iter().filter(|frame| frame.id == id::GYRO).count(), 1990);
    assert_eq!(parser.skipped(), golden["bytes_skipped"].as_u64().unwrap());
}

#[test]
fn the_clean_stream_gives_every_sample_with_its_time() {
    let (Some(path), Some(truth)) = (
        evac_testkit::data("protocols/wt901c/wt901c_200hz_10s_clean.bin"),
        bytes("wt901c_200hz_10s_truth.json"),
    ) else {
        return;
    };
    let truth: Value = serde_json::from_slice(&truth).unwrap();
    let mut reader = Wt901cReader::open(&path).unwrap();
    let mut first = None;
    for (k, expected) in truth["samples"].as_array().unwrap().iter().enumerate() {
        let sample = reader.next_sample().unwrap().unwrap();
        assert_eq!(sample.accel, triple(&expected["acc_raw"]));
        assert_eq!(sample.gyro, triple(&expected["gyro_raw"]));
        // The time frame comes first in its group.
        assert_eq!(sample.offset, expected["byte_offset_clean"].as_u64().unwrap() + 11);
        let time = sample.time_ns.unwrap();
        // The module's clock is 80 ppm slow and cut to milliseconds.
        let elapsed = time - *first.get_or_insert(time);
        assert!((elapsed - k as i64 * 5_000_000).abs() <= 2_000_000, "{elapsed} ns at sample {k}");
    }
    assert_eq!(reader.next_sample().unwrap(), None);
    let counts = reader.counts();
    assert_eq!((counts.samples, counts.frames, counts.skipped, counts.incomplete), (2000, 8000, 0, 0));
}

#[test]
fn samples_of_the_damaged_stream_are_whole_ones_of_the_truth() {
    let (Some(path), Some(truth)) = (
        evac_testkit::data("protocols/wt901c/wt901c_200hz_10s_corrupt.bin"),
        bytes("wt901c_200hz_10s_truth.json"),
    ) else {
        return;
    };
    let truth: Value = serde_json::from_slice(&truth).unwrap();
    let truth: Vec<_> = truth["samples"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| (triple(&s["acc_raw"]), triple(&s["gyro_raw"])))
        .collect();
    let mut reader = Wt901cReader::open(&path).unwrap();
    let (mut from, mut samples) = (0, 0);
    while let Some(sample) = reader.next_sample().unwrap() {
        let at = truth[from..].iter().position(|pair| *pair == (sample.accel, sample.gyro));
        from += at.unwrap_or_else(|| panic!("sample {samples} never was: {sample:?}")) + 1;
        samples += 1;
    }
    let counts = reader.counts();
    // 1988 accelerometer and 1990 gyroscope frames are good; a sample needs both.
    assert!((1978..=1988).contains(&samples), "{samples}");
    assert_eq!(counts.samples, samples);
    assert!(counts.incomplete >= 2 && counts.skipped == 432, "{counts:?}");
}

#[test]
fn single_frames_are_read_and_written_byte_for_byte() {
    let Some(golden) = bytes("single_frames.json") else { return };
    let golden: Value = serde_json::from_slice(&golden).unwrap();
    let mut compared = 0;
    for case in golden.as_array().unwrap() {
        let text = case["frame_hex"].as_str().unwrap();
        let bytes: Vec<u8> =
            (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap()).collect();
        let mut parser = Parser::default();
        let frame = bytes.iter().filter_map(|byte| parser.push(*byte)).next().unwrap();
        let encoded = match frame.id {
            id::TIME => {
                // 2026-11-21 14:34:05.678
                assert_eq!(frame.time_ns(), Some(1_795_271_645_678_000_000));
                encode_time(frame.time_ns().unwrap()).unwrap()
            }
            id::ACCEL => encode_accel(frame.triple(), frame.words()[3]),
            id::GYRO => encode_gyro(frame.triple(), frame.words()[3]),
            _ => continue,
        };
        assert_eq!(encoded.as_slice(), bytes);
        compared += 1;
    }
    assert_eq!(compared, 4);
}

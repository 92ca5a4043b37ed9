//! The WT901C's byte stream against streams parsed by the vendor's own parser.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use evac_formats::wt901c::modbus::{self, ReplyParser, Request};
use evac_formats::wt901c::{
    Command, CommandParser, Parser, Reading, Scales, Wt901cReader, bandwidth_code, baud_code, content,
    encode_accel, encode_gyro, encode_time, encode_words, id, rate_code, register,
};
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

/// Bytes of a hexadecimal text.
fn hex(text: &str) -> Vec<u8> {
    (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap()).collect()
}

fn close(value: &[f64], expected: &[f64]) -> bool {
    value.len() == expected.len() && value.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6)
}

#[test]
fn single_frames_are_read_and_written_byte_for_byte() {
    let Some(golden) = bytes("single_frames.json") else { return };
    let golden: Value = serde_json::from_slice(&golden).unwrap();
    let scales = Scales::default();
    let mut compared = 0;
    for case in golden.as_array().unwrap() {
        let bytes = hex(case["frame_hex"].as_str().unwrap());
        let mut parser = Parser::default();
        let frame = bytes.iter().filter_map(|byte| parser.push(*byte)).next().unwrap();
        assert_eq!(encode_words(frame.id, frame.words()).as_slice(), bytes);
        let name = case["name"].as_str().unwrap();
        let right = match (name, frame.reading(&scales).unwrap()) {
            // 2026-11-21 14:34:05.678
            ("time", Reading::Time(time_ns)) => {
                assert_eq!(encode_time(time_ns).unwrap().as_slice(), bytes);
                time_ns == 1_795_271_645_678_000_000
            }
            ("acc", Reading::Accel { accel, temperature_c }) => {
                assert_eq!(encode_accel(frame.triple(), frame.words()[3]).as_slice(), bytes);
                close(&accel, &[9.80665, -2.0 * 9.80665, 8.0 * 9.80665]) && temperature_c == 25.34
            }
            ("gyro", Reading::Gyro { gyro }) => {
                assert_eq!(encode_gyro(frame.triple(), frame.words()[3]).as_slice(), bytes);
                close(&gyro, &[1000.0, -2000.0, 0.061_035_156_25].map(f64::to_radians))
            }
            ("angle", Reading::Angles { roll_pitch_yaw, version }) => {
                let degrees = roll_pitch_yaw.map(f64::to_degrees);
                (degrees[0], degrees[1]) == (90.0, -45.0)
                    && (degrees[2] - 179.994_506).abs() < 1e-5
                    && version == 0x3085
            }
            ("mag", Reading::Magnetometer(field)) => field == [120, -340, 560],
            ("quaternion", Reading::Quaternion(q)) => close(&q, &[32767.0 / 32768.0, 0.0, 0.0, -0.5]),
            ("register read reply", Reading::Registers(values)) => values == [7, 11, 6, 0],
            ("payload containing a false header", _) => frame.triple() == [0x5155, 0x5255, 0x5355],
            (name, reading) => panic!("{name} was read as {reading:?}"),
        };
        assert!(right, "{name}: {frame:?}");
        compared += 1;
    }
    assert_eq!(compared, 8);
}

#[test]
fn commands_are_those_of_the_vendor_s_code() {
    let Some(golden) = bytes("commands.json") else { return };
    let golden: Value = serde_json::from_slice(&golden).unwrap();
    let own = |call: &str| {
        Some(match call {
            "WitReadReg(AX,3)" => Command::read(register::VALUES),
            "WitReadReg(RSW,1)" => Command::read(register::CONTENT),
            "WitSetContent(RSW_ACC|RSW_GYRO)" => {
                Command::write(register::CONTENT, content::ACCEL | content::GYRO)
            }
            "WitSetContent(RSW_ACC|RSW_GYRO|RSW_ANGLE|RSW_MAG)" => Command::write(
                register::CONTENT,
                content::ACCEL | content::GYRO | content::ANGLE | content::MAGNETOMETER,
            ),
            "WitSetContent(RSW_TIME|RSW_ACC|RSW_GYRO|RSW_Q)" => Command::write(
                register::CONTENT,
                content::TIME | content::ACCEL | content::GYRO | content::QUATERNION,
            ),
            "WitSetOutputRate(RRATE_200HZ)" => Command::write(register::RATE, rate_code(200.0)?),
            "WitSetOutputRate(RRATE_10HZ)" => Command::write(register::RATE, rate_code(10.0)?),
            "WitSetUartBaud(WIT_BAUD_115200)" => Command::write(register::BAUD, baud_code(115_200)?),
            "WitSetUartBaud(WIT_BAUD_230400)" => Command::write(register::BAUD, baud_code(230_400)?),
            "WitSetBandwidth(BANDWIDTH_94HZ)" => Command::write(register::BANDWIDTH, bandwidth_code(94)?),
            "WitSetBandwidth(BANDWIDTH_256HZ)" => Command::write(register::BANDWIDTH, bandwidth_code(256)?),
            "WitStartAccCali()" => Command::write(register::CALIBRATION, 1),
            "WitStopAccCali()" | "WitStopMagCali()" => Command::write(register::CALIBRATION, 0),
            "WitStartMagCali()" => Command::write(register::CALIBRATION, 7),
            "WitCaliRefAngle()" => Command::write(register::CALIBRATION, 8),
            "WitSaveParameter()" => Command::SAVE,
            "WitSetForReset()" => Command::RESTART,
            // The vendor's code refuses this speed; the bytes would be ours alone.
            "WitSetUartBaud(WIT_BAUD_460800)" => return None,
            other => panic!("{other} is new"),
        })
    };
    let mut compared = 0;
    for case in golden["commands"].as_array().unwrap() {
        let emitted = case["emitted"].as_array().unwrap();
        let Some(command) = own(case["call"].as_str().unwrap()) else {
            assert!(emitted.is_empty());
            continue;
        };
        let last = hex(emitted.last().unwrap().as_str().unwrap());
        assert_eq!(command.bytes().as_slice(), last);
        let mut parser = CommandParser::default();
        // Rubbish before it, one byte of which looks like a beginning.
        let read = [0x00, 0xff].iter().chain(&last).filter_map(|byte| parser.push(*byte)).last();
        assert_eq!(read, Some(command));
        if emitted.len() == 3 {
            assert_eq!(Command::UNLOCK.bytes().as_slice(), hex(emitted[0].as_str().unwrap()));
        }
        compared += 1;
    }
    assert_eq!(compared, 18);
}

#[test]
fn modbus_requests_and_replies_are_those_of_the_vendor_s_code() {
    let Some(text) = bytes("modbus_vendor.txt") else { return };
    let text = String::from_utf8(text).unwrap();
    let mut lines = text.lines();
    let mut request = || -> [u8; 8] { hex(lines.next().unwrap()).try_into().unwrap() };
    for own in [
        Request::Read { first: register::VALUES, count: 12 },
        Request::Write { register: register::KEY, value: 0xb588 },
        Request::Write { register: register::RATE, value: rate_code(200.0).unwrap() },
        Request::Read { first: register::VALUES, count: 3 },
    ] {
        let theirs = request();
        assert_eq!(own.bytes(modbus::ADDRESS), theirs);
        assert_eq!(Request::parse(&theirs, modbus::ADDRESS), Some(own));
        assert_eq!(Request::parse(&theirs, 0x51), None);
    }
    let reply = hex(lines.next().unwrap().trim_start_matches("reply "));
    let registers = [2048, -2048, 2047].map(i16::cast_unsigned);
    let mut buffer = [0; modbus::MAX_REPLY_BYTES];
    let length = modbus::encode_reply(modbus::ADDRESS, &registers, &mut buffer).unwrap();
    assert_eq!(&buffer[..length], reply);
    let mut parser = ReplyParser::new(modbus::ADDRESS, 3);
    // The beginning of a reply, then another one whole.
    let found: Vec<_> = reply[..4].iter().chain(&reply).filter_map(|byte| parser.push(*byte)).collect();
    assert_eq!(found.len(), 1);
    assert_eq!((&found[0][..3], parser.skipped()), (registers.as_slice(), 4));
}

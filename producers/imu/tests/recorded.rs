//! The reference byte streams, played to the driver over a real pseudo-terminal.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use common::Driver;
use evac_formats::wt901c::{Scales, Wt901cReader};
use evac_imu::Config;
use rustix::pty::{OpenptFlags, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use serde_json::Value;

/// Bytes of a sample: time, accelerometer, gyroscope, angles.
const SAMPLE_BYTES: usize = 44;

/// Plays a file at 200 samples a second and gives what the driver made of it.
fn play(name: &str) -> Option<(PathBuf, Driver)> {
    let path = evac_testkit::data(&format!("protocols/wt901c/{name}"))?;
    let bytes = std::fs::read(&path).unwrap();
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    unlockpt(&master).unwrap();
    let mut settings = tcgetattr(&master).unwrap();
    settings.make_raw();
    tcsetattr(&master, OptionalActions::Now, &settings).unwrap();
    let port = ptsname(&master, Vec::new()).unwrap().into_string().unwrap().into();
    let mut driver = Driver::new(Config { port, configure: false, angles: true, ..Config::default() });
    driver.run_until_noted("listening");
    let player = std::thread::spawn(move || {
        let start = Instant::now();
        for (number, chunk) in bytes.chunks(SAMPLE_BYTES).enumerate() {
            let due = start + Duration::from_millis(5) * number as u32;
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            rustix::io::write(&master, chunk).unwrap();
        }
        master
    });
    while !player.is_finished() {
        driver.serve();
    }
    let _master = player.join().unwrap();
    for _ in 0..4 {
        driver.serve();
    }
    Some((path, driver))
}

/// Whether the published samples are ones of the truth, in its order, at their places in time.
fn check_against_truth(driver: &Driver) {
    let truth = evac_testkit::data("protocols/wt901c/wt901c_200hz_10s_truth.json").unwrap();
    let truth: Value = serde_json::from_slice(&std::fs::read(truth).unwrap()).unwrap();
    let triple = |value: &Value| [0, 1, 2].map(|axis| value[axis].as_i64().unwrap() as i16);
    let scales = Scales::default();
    let truth: Vec<_> = truth["samples"]
        .as_array()
        .unwrap()
        .iter()
        .map(|sample| (scales.accel(triple(&sample["acc_raw"])), scales.gyro(triple(&sample["gyro_raw"]))))
        .collect();
    let (mut from, mut places) = (0, Vec::new());
    for sample in &driver.output.memory {
        let at = truth[from..].iter().position(|truth| *truth == (sample.accel, sample.gyro));
        assert!(at.is_some(), "never was: {sample:?}");
        from += at.unwrap() + 1;
        places.push(from);
    }
    for (places, samples) in places.windows(2).zip(driver.output.memory.windows(2)) {
        let elapsed = (samples[1].stamp_ns - samples[0].stamp_ns) as f64 / 5e6;
        let expected = (places[1] - places[0]) as f64;
        assert!((elapsed - expected).abs() < 0.1 + 0.03 * expected, "{elapsed} periods for {expected}");
    }
}

#[test]
fn the_damaged_stream_gives_the_listed_samples_and_no_other() {
    let Some((path, driver)) = play("wt901c_200hz_10s_corrupt.bin") else { return };
    let mut reader = Wt901cReader::open(&path).unwrap();
    while reader.next_sample().unwrap().is_some() {}
    let listed = reader.counts();
    let whole = driver.output.memory.len() as u64 + driver.reporter.counters.late;
    // The first sample is heard while the speed is looked for.
    assert_eq!(whole, listed.samples - 1);
    assert_eq!(driver.reporter.counters.rejected, listed.skipped);
    assert_eq!(whole + 1 + driver.reporter.input.imu_lost, 2000);
    check_against_truth(&driver);
}

#[test]
fn the_clean_stream_gives_every_sample() {
    let Some((_, driver)) = play("wt901c_200hz_10s_clean.bin") else { return };
    assert_eq!((driver.output.memory.len(), driver.reporter.counters.late), (1999, 0));
    assert_eq!((driver.reporter.counters.rejected, driver.reporter.input.imu_lost), (0, 0));
    check_against_truth(&driver);
}

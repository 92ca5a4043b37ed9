//! Recordings of the test data, unpacked.
#![allow(
    dead_code,
    clippy::unwrap_used,
    clippy::panic,
    reason = "parts of tests, of which each file uses some"
)]

pub(crate) mod bag;

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use evac_frames::{ImuSample, Point, ScanHeader};
use evac_replay::{Config, Replay};
use evac_stage::{Counters, Rig, SensorEvent, Source};

/// A file of a simulated walk, unpacked once into the build's folder; `None` (and a line) where it cannot be had.
pub(crate) fn unpacked(walk: &str, file: &str) -> Option<PathBuf> {
    let packed = evac_testkit::data(&format!("simulated/{walk}/{file}.xz"))?;
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("walks").join(walk);
    let path = folder.join(file);
    if path.exists() {
        return Some(path);
    }
    fs::create_dir_all(&folder).unwrap();
    let part = folder.join(format!("{file}.{}.part", std::process::id()));
    let status = Command::new("xz").arg("-dc").arg(&packed).stdout(File::create(&part).unwrap()).status();
    if !status.is_ok_and(|status| status.success()) {
        println!("skipped: no xz to unpack {walk}/{file}");
        return None;
    }
    fs::rename(part, &path).unwrap();
    Some(path)
}

/// A simulated walk's capture and byte log.
pub(crate) fn walk(name: &str) -> Option<Config> {
    Some(Config {
        lidar: Some(unpacked(name, "lidar.pcap")?),
        imu: Some(unpacked(name, "wt901c.bin")?),
        ..Config::default()
    })
}

pub(crate) fn bag(path: &str) -> Option<Config> {
    Some(Config { bag: Some(evac_testkit::data(path)?), ..Config::default() })
}

pub(crate) fn open(config: Config) -> Replay {
    Replay::new(config, &Rig::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// What opening or replaying says about a bad recording.
pub(crate) fn error_of(config: Config) -> String {
    let mut replay = match Replay::new(config, &Rig::default()) {
        Ok(replay) => replay,
        Err(error) => return error.to_string(),
    };
    loop {
        match replay.next_event() {
            Ok(Some(_)) => {}
            Ok(None) => panic!("the recording was accepted"),
            Err(error) => return error.to_string(),
        }
    }
}

/// A replay, told.
#[derive(Default)]
pub(crate) struct Told {
    pub(crate) scans: Vec<ScanHeader>,
    pub(crate) imu: Vec<ImuSample>,
    pub(crate) points: Vec<Point>,
    pub(crate) returns: u64,
    pub(crate) total: Option<u64>,
    /// At the end.
    pub(crate) counters: Counters,
}

/// Replays everything, checks the order of events, and keeps the points of the first `keep` scans.
pub(crate) fn tell(config: Config, keep: usize) -> Told {
    let mut replay = open(config);
    let mut told = Told { total: replay.total_scans(), ..Told::default() };
    let mut time = i64::MIN;
    while let Some(event) = replay.next_event().unwrap() {
        let at = match event {
            SensorEvent::Imu(sample) => {
                told.imu.push(sample);
                sample.stamp_ns
            }
            SensorEvent::Scan(header) => {
                for index in 0..header.points as usize {
                    let point = replay.point(index);
                    assert!(point.is_finite());
                    told.returns += u64::from(point.is_return());
                    if told.scans.len() < keep {
                        told.points.push(point);
                    }
                }
                told.scans.push(header);
                header.frame.end_ns
            }
        };
        assert!(at >= time, "events go back from {time} to {at}");
        time = at;
    }
    told.counters = replay.counters();
    told
}

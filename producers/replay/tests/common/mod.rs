//! Recordings of the test data, unpacked.
#![allow(
    dead_code,
    clippy::unwrap_used,
    clippy::panic,
    reason = "parts of tests, of which each file uses some"
)]

pub(crate) mod bag;

use evac_frames::{ImuSample, Point, ScanHeader};
use evac_replay::{Config, Replay};
use evac_stage::{Counters, Rig, SensorEvent, Source};

/// A simulated walk's capture and byte log.
pub(crate) fn walk(name: &str) -> Option<Config> {
    Some(Config {
        lidar: Some(evac_testkit::unpacked(&format!("simulated/{name}/lidar.pcap"))?),
        imu: Some(evac_testkit::unpacked(&format!("simulated/{name}/wt901c.bin"))?),
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

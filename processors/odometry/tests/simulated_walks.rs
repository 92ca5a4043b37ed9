//! The three recorded walks of the test data, through replay, deskewer and odometry in one process.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic as the test may")]

mod common;

use std::fs::File;
use std::path::Path;

use common::{Figures, Pipeline, print};
use evac_config::ImuFromLidar;
use evac_frames::{ImuSample, Point, ScanHeader};
use evac_geometry::isometry;
use evac_replay::Replay;
use evac_stage::{Rig, SensorEvent, Source};

#[test]
fn the_corridor_walk_ends_within_two_percent() {
    assert_walk("corridor", 2.0);
}

#[test]
fn the_hall_walk_ends_within_two_percent() {
    assert_walk("hall", 2.0);
}

#[test]
fn the_shaken_walk_ends_within_three_percent() {
    assert_walk("shake", 3.0);
}

fn assert_walk(name: &str, percent: f64) {
    let Some(folder) = evac_testkit::data(&format!("simulated/{name}")) else { return };
    let file = |file: &str| evac_testkit::unpacked(&format!("simulated/{name}/{file}"));
    let (Some(lidar), Some(imu)) = (file("lidar.pcap"), file("wt901c.bin")) else { return };
    let rig = rig_of(&folder);
    let config = evac_replay::Config { lidar: Some(lidar), imu: Some(imu), ..Default::default() };
    let pipeline = run(config, &rig);
    let truth: Vec<_> = evac_formats::tum::read(&folder.join("gt.tum"))
        .unwrap()
        .iter()
        .map(|pose| isometry(pose.position, pose.orientation))
        .collect();
    let figures = Figures::of(pipeline.trajectory(), &truth);
    print(name, &pipeline, &figures);
    assert!(figures.drift_percent() < percent, "drift {:.3} %", figures.drift_percent());
    assert!(figures.ape < 0.15, "APE {:.3} m", figures.ape);
    assert!(figures.rotation_deg < 1.0, "end rotation {:.3} degrees", figures.rotation_deg);
    assert_eq!(figures.lost, 0);
}

fn run(config: evac_replay::Config, rig: &Rig) -> Pipeline {
    let mut replay = Replay::new(config, rig).unwrap();
    let mut pipeline = Pipeline::new(rig);
    let mut imu: Vec<ImuSample> = Vec::new();
    let mut waiting: Option<(ScanHeader, Vec<Point>)> = None;
    loop {
        let event = replay.next_event().unwrap();
        if let Some(SensorEvent::Imu(sample)) = &event {
            imu.push(*sample);
        }
        // A scan goes on once the IMU covers it, as in the run loop.
        if let Some((header, points)) = waiting.take() {
            let end_ns = header.frame.end_ns;
            if event.is_none() || imu.last().is_some_and(|sample| sample.stamp_ns >= end_ns) {
                pipeline.feed(&header, &points, &imu);
                let border = imu.partition_point(|sample| sample.stamp_ns <= end_ns).saturating_sub(1);
                imu.drain(..border);
            } else {
                waiting = Some((header, points));
            }
        }
        match event {
            Some(SensorEvent::Scan(header)) => {
                assert!(waiting.is_none(), "the IMU lags more than a frame");
                let points: Vec<_> = (0..header.points as usize).map(|i| replay.point(i)).collect();
                waiting = Some((header, points));
            }
            Some(_) => {}
            None => return pipeline,
        }
    }
}

/// The rig from the walk's `meta.json`: lever arm, then yaw, pitch, roll in degrees.
fn rig_of(folder: &Path) -> Rig {
    let meta: serde_json::Value =
        serde_json::from_reader(File::open(folder.join("meta.json")).unwrap()).unwrap();
    let [x, y, z, yaw, pitch, roll] =
        [0, 1, 2, 3, 4, 5].map(|i| meta["T_imu_lidar_xyz_ypr"][i].as_f64().unwrap());
    Rig { imu_from_lidar: ImuFromLidar { translation_m: [x, y, z], roll_pitch_yaw_deg: [roll, pitch, yaw] } }
}

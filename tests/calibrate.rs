//! `evac calibrate` over a recorded walk.
#![allow(clippy::unwrap_used)]

mod common;

use common::Bench;
use serde_json::Value;

const USAGE: i32 = 2;
const FAILED: i32 = 1;
const CONFIG: i32 = 3;
const FILE: i32 = 4;

/// Records a walk through an open hall into `walk`.
fn recorded(seconds: &str) -> Bench {
    let bench = Bench::new();
    bench
        .run([
            "demo",
            "--world",
            "open-hall",
            "--building",
            "3",
            "--seed",
            "501",
            "--duration",
            seconds,
            "--domain",
            bench.domain.name(),
            "--record",
            "walk",
            "-o",
            "out",
        ])
        .expect_success();
    // The simulator's rig is 0.5, -1.0, 1.5 degrees: this one is off by 1.9 degrees.
    let wrong = "translation_m = [0.05, -0.02, 0.06]\nroll_pitch_yaw_deg = [1.5, -2.0, 2.8]\n";
    bench.write("wrong.toml", format!("[rig.imu_from_lidar]\n{wrong}"));
    bench
}

const WALK: [&str; 6] = ["--lidar", "walk/lidar.pcap", "--imu", "walk/wt901c.bin", "--rig", "wrong.toml"];

#[test]
fn a_recorded_walk_gives_back_the_rig_and_the_clock_that_it_was_made_with() {
    let bench = recorded("40");
    let args = ["calibrate", "--imu-offset-ms", "25", "-o", "new/rig.toml"];
    let ended = bench.run(args.iter().chain(&WALK)).expect_success();
    for word in [
        "time offset",
        "rotation z",
        "gyro scale x",
        "standard error",
        "roll_pitch_yaw_deg = [",
        "time_offset_ms = ",
    ] {
        assert!(ended.stdout.contains(word), "no '{word}' in:\n{}", ended.stdout);
    }
    let said: Value = serde_json::from_str(&bench.text("new/calibration.json")).unwrap();
    let estimate = |name: usize| said["calibration"]["estimates"][name].clone();
    assert!((estimate(0)["value"].as_f64().unwrap() + 25.0).abs() < 2.0, "{said:#}");
    let rig: toml::Table = toml::from_str(&bench.text("new/rig.toml")).unwrap();
    let angles = rig["rig"]["imu_from_lidar"]["roll_pitch_yaw_deg"].as_array().unwrap();
    for (angle, truth) in angles.iter().zip([0.5, -1.0, 1.5]) {
        assert!((angle.as_float().unwrap() - truth).abs() < 0.5, "{rig}");
    }

    // The file is one that `evac map` takes; only what was asked for is changed and shown.
    let args =
        ["calibrate", "time", "--imu-offset-ms", "25", "-o", "time/rig.toml", "--lidar", "walk/lidar.pcap"];
    let time =
        bench.run(args.iter().chain(&["--imu", "walk/wt901c.bin", "--rig", "new/rig.toml"])).expect_success();
    assert!(time.stdout.contains("time offset") && !time.stdout.contains("rotation x"), "{}", time.stdout);
    let kept: toml::Table = toml::from_str(&bench.text("time/rig.toml")).unwrap();
    assert_eq!(kept, rig);
}

#[test]
fn what_cannot_be_calibrated_is_refused_with_cause_and_remedy() {
    let bench = recorded("4");
    bench
        .run(["calibrate"].iter().chain(&WALK))
        .expect_error(FAILED, &["walk/lidar.pcap", "walk for a minute"]);
    bench.run(["calibrate", "nowhere.bag"]).expect_error(FILE, &["nowhere.bag", "check the path"]);
    let args = ["calibrate", "rotation", "--duration", "1"];
    bench.run(args.iter().chain(&WALK)).expect_error(CONFIG, &["--duration", "at least 10"]);
    assert_eq!(bench.run(["calibrate"]).code, USAGE);
    assert!(!bench.path("calibration.json").exists());
}

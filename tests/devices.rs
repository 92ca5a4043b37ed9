//! `evac demo --devices`: the whole pipeline through real drivers, a real network socket and a real serial line.
#![allow(clippy::unwrap_used)]

mod common;

use common::Bench;
use serde_json::Value;

#[test]
fn a_walk_through_the_drivers_becomes_the_same_map_as_without_them() {
    let bench = Bench::new();
    let path = bench.path("out");
    let args =
        ["demo", "--devices", "--duration", "14", "--seed", "3", "--domain", bench.domain.name(), "-o"];
    bench.run(args.iter().map(std::ffi::OsStr::new).chain([path.as_os_str()])).expect_success();
    let summary: Value = serde_json::from_str(&bench.text("out/summary.json")).unwrap();
    // The first half second goes into the fit of the LiDAR's clock.
    let scans = summary["stages"]["lidar"]["frames"]["out"].as_u64().unwrap();
    assert!((120..=141).contains(&scans), "{scans}");
    assert_eq!(summary["stages"]["device_simulator"]["frames"]["out"], 140);
    assert!(summary["drift"]["path_m"].as_f64().unwrap() > 5.0, "{summary}");
    for stage in ["device_simulator", "lidar", "imu"] {
        assert!(summary["stages"][stage]["cpu_percent"].as_f64().is_some(), "{stage}");
    }
    for file in ["map.ot", "map.bt", "plan.pgm", "trajectory.tum", "truth.tum", "cloud.pcd"] {
        assert!(!bench.bytes(&format!("out/{file}")).is_empty(), "{file}");
    }
    assert!(!bench.path("out/wt901c").exists(), "the serial port is unplugged at the end");
    assert_eq!(bench.leftovers(), Vec::<String>::new());
    // A busy machine may lose packets or be late with scans, and says so; then nothing can be said about the map.
    let undisturbed = summary["stages"]["device_simulator"]["frames"]["degraded"] == 0
        && summary["stages"]["lidar"]["frames"]["degraded"] == 0
        && summary["frames_lost"] == 0;
    if undisturbed {
        assert!(summary["drift"]["end_percent"].as_f64().unwrap() < 2.0, "{}", summary["drift"]);
    } else {
        println!("skipped: the machine was too busy to judge the map: {}", summary["stages"]);
    }
}

#[test]
fn what_a_device_cannot_do_is_said_before_anything_starts() {
    let bench = Bench::new();
    let file = bench.write(
        "bad.toml",
        "mode = \"live\"\n[[stage]]\nkind = \"lidar\"\n[stage.config]\nframe_ms = 200.0\n",
    );
    bench.run(["check".as_ref(), file.as_os_str()]).expect_error(3, &["frame_ms", "10 and 150"]);
    let file = bench.write("lossless.toml", "mode = \"lossless\"\n[[stage]]\nkind = \"lidar\"\n");
    let args = ["stage".as_ref(), "lidar".as_ref(), "--config".as_ref(), file.as_os_str()];
    bench.run(args).expect_error(3, &["lossless", "live"]);
}

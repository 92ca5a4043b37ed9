//! `evac demo --devices`: the whole pipeline through real drivers, a real network socket and a real serial line.
#![allow(clippy::unwrap_used)]

mod common;

use common::Bench;
use serde_json::Value;

/// `evac demo --devices` with further options; its summary.
fn demo(bench: &Bench, options: &[&str]) -> Value {
    let path = bench.path("out");
    let args =
        ["demo", "--devices", "--duration", "14", "--seed", "3", "--domain", bench.domain.name(), "-o"];
    let args = args.iter().map(std::ffi::OsStr::new).chain([path.as_os_str()]);
    bench.run(args.chain(options.iter().map(std::ffi::OsStr::new))).expect_success();
    let summary = serde_json::from_str(&bench.text("out/summary.json")).unwrap();
    for file in ["map.ot", "map.bt", "plan.pgm", "trajectory.tum", "truth.tum", "cloud.pcd"] {
        assert!(!bench.bytes(&format!("out/{file}")).is_empty(), "{file}");
    }
    assert_eq!(bench.leftovers(), Vec::<String>::new());
    summary
}

/// On a busy machine packets may get lost or scans be simulated or processed too late, and all is said; then nothing follows for the
/// map.
#[track_caller]
fn judge(summary: &Value) {
    let frames = |stage: &str, key: &str| summary["stages"][stage]["frames"][key].as_u64().unwrap();
    let disturbed = frames("device_simulator", "degraded")
        + frames("lidar", "degraded")
        + frames("lio", "lost")
        + frames("lio", "late");
    if disturbed > 0 {
        println!("skipped: the machine was too busy to judge the map: {}", summary["stages"]);
        return;
    }
    // The first half second goes into the fit of the LiDAR's clock.
    let scans = frames("lidar", "out");
    assert!((120..=146).contains(&scans), "{scans}");
    assert_eq!(frames("lio", "out"), scans);
    assert!(summary["drift"]["path_m"].as_f64().unwrap() > 5.0, "{summary}");
    assert!(summary["drift"]["end_percent"].as_f64().unwrap() < 2.0, "{}", summary["drift"]);
}

#[test]
fn a_walk_through_the_drivers_becomes_the_same_map_as_without_them() {
    let bench = Bench::new();
    let summary = demo(&bench, &[]);
    assert_eq!(summary["stages"]["device_simulator"]["frames"]["out"], 140);
    for stage in ["device_simulator", "lidar", "imu"] {
        assert!(summary["stages"][stage]["cpu_percent"].as_f64().is_some(), "{stage}");
    }
    assert!(!bench.path("out/wt901c").exists(), "the serial port is unplugged at the end");
    judge(&summary);
}

#[test]
fn a_walk_is_mapped_with_nothing_but_a_livox_device_that_has_an_imu() {
    for lidar in ["avia", "mid360"] {
        let bench = Bench::new();
        let summary = demo(&bench, &["--lidar", lidar]);
        assert!(summary["stages"]["imu"].is_null(), "{lidar}: {}", summary["stages"]);
        // Scans were deskewed by the device's samples, and located.
        assert!(
            summary["stages"]["lio"]["frames"]["out"].as_u64() > Some(0),
            "{lidar}: {}",
            summary["stages"]
        );
        judge(&summary);
    }
}

#[test]
fn faults_on_request_happen_to_a_walk_that_goes_on_and_the_summary_has_them_all() {
    let bench = Bench::new();
    let faults = ["lost=0.05@1+2", "clock-step=500@3", "cable@4+5", "imu-cable@5+1"];
    let options: Vec<_> = faults.iter().flat_map(|fault| ["--fault", fault]).collect();
    let summary = demo(&bench, &options);
    let device = |stage: &str| summary["stages"][stage]["device"].clone();
    let (lidar, imu) = (device("lidar"), device("imu"));
    assert_eq!((&lidar["kind"], &imu["kind"]), (&Value::from("livox_sdk1"), &Value::from("wt901c")));
    let count = |value: &Value| value.as_u64().unwrap();
    assert!(count(&lidar["packets"]["lost"]) > 20 && count(&lidar["clock_steps"]) >= 1, "{lidar}");
    assert!(count(&lidar["sessions"]) >= 2 && count(&imu["sessions"]) >= 2, "{lidar} {imu}");
    assert!(count(&lidar["packets"]["used"]) > 0 && lidar["flags"]["voltage"] == "ok", "{lidar}");
    let refused = bench.run(["demo", "--devices", "--fault", "cable"]);
    assert!(refused.code == 2 && refused.stderr.contains("say how long"), "{}", refused.stderr);
}

#[test]
fn who_writes_the_imu_samples_is_chosen_in_the_pipeline_file() {
    let bench = Bench::new();
    let lidar =
        |publish: bool| format!("[[stage]]\nkind = \"lidar\"\n[stage.config]\npublish_imu = {publish}\n");
    let deskewer = "[[stage]]\nkind = \"deskewer\"\n";
    let check = |text: String| {
        let file = bench.write("robot.toml", format!("mode = \"live\"\n{text}"));
        bench.run(["check".as_ref(), file.as_os_str()])
    };
    let alone = check(lidar(true) + deskewer).expect_success();
    assert!(alone.stdout.contains("-> lidar/scan imu/sample"), "{}", alone.stdout);
    check(lidar(false) + deskewer).expect_error(3, &["imu/sample", "publish_imu = true"]);
    let both = lidar(true) + "[[stage]]\nkind = \"imu\"\n" + deskewer;
    check(both).expect_error(3, &["'lidar' and 'imu' both write imu/sample"]);
    for shipped in ["devices", "mid360"] {
        let file = format!("{}/launch/pipelines/{shipped}.toml", env!("CARGO_MANIFEST_DIR"));
        bench.run(["check", file.as_str()]).expect_success();
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

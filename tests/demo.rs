//! `evac demo`: the whole pipeline as processes, from a simulated walk to the maps.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Bench, other_program};
use serde_json::Value;

/// Standstill, start and the first metres: enough for a map, short enough for every run of the tests.
const SECONDS: &str = "14";

fn demo(bench: &Bench, output: &str, seed: &str) {
    let path = bench.path(output);
    let args = ["demo", "--duration", SECONDS, "--domain", bench.domain.name(), "--seed", seed, "-o"];
    bench.run(args.iter().map(std::ffi::OsStr::new).chain([path.as_os_str()])).expect_success();
}

#[test]
fn a_simulated_walk_becomes_maps_without_losing_a_frame_and_the_same_ones_every_time() {
    let bench = Bench::new();
    demo(&bench, "a", "3");
    let summary: Value = serde_json::from_str(&bench.text("a/summary.json")).unwrap();
    assert_eq!(summary["frames"], 140);
    assert_eq!(summary["frames_lost"], 0);
    for stage in ["simulator", "deskewer", "lio", "octree_mapper", "grid_exporter", "map_saver"] {
        assert_eq!(summary["stages"][stage]["frames"]["out"], 140, "{stage}");
        assert_eq!(summary["stages"][stage]["frames"]["lost"], 0, "{stage}");
        assert!(summary["stages"][stage]["latency"]["compute"]["count"].as_u64() > Some(0), "{stage}");
    }
    assert!(summary["drift"]["path_m"].as_f64().unwrap() > 5.0);
    assert!(summary["drift"]["end_percent"].as_f64().unwrap() < 2.0, "{}", summary["drift"]);

    assert_eq!(bench.text("a/trajectory.tum").lines().count(), 140);
    assert!(bench.text("a/plan.yaml").contains("free_thresh: 0.196"));
    let plan = bench.bytes("a/plan.pgm");
    for (value, what) in [(0, "occupied"), (254, "free"), (205, "unknown")] {
        let cells = plan.iter().filter(|byte| **byte == value).count();
        assert!(cells > 100, "{cells} {what} cells");
    }
    assert!(bench.bytes("a/plan.png").starts_with(b"\x89PNG"));
    assert!(bench.bytes("a/cloud.pcd").len() > 100_000);
    assert_eq!(bench.leftovers(), Vec::<String>::new());

    demo(&bench, "b", "3");
    for file in ["trajectory.tum", "map.ot", "map.bt", "plan.pgm", "plan.yaml", "plan.png", "cloud.pcd"] {
        assert!(bench.bytes(&format!("a/{file}")) == bench.bytes(&format!("b/{file}")), "{file} differs");
    }
    demo(&bench, "c", "4");
    assert!(bench.bytes("a/trajectory.tum") != bench.bytes("c/trajectory.tum"), "the seed has no effect");

    // octomap-tools end with code 0 whatever happens: the file they write tells whether they read ours.
    for file in ["a/map.ot", "a/map.bt"] {
        let back = bench.path("back.ot");
        if let Some(output) = other_program("convert_octree", &[&bench.path(file), &back]) {
            let said = String::from_utf8_lossy(&output.stderr).into_owned()
                + &String::from_utf8_lossy(&output.stdout);
            assert!(bench.path("back.ot").exists(), "{file}: {said}");
            let ours = evac_formats::octomap::read(&bench.path(file)).unwrap();
            let theirs = evac_formats::octomap::read(&back).unwrap();
            assert_eq!(ours.nodes().len(), theirs.nodes().len(), "{file}");
            std::fs::remove_file(back).unwrap();
        }
    }
}

#[test]
fn a_recorded_walk_maps_like_the_walk_itself() {
    let bench = Bench::new();
    let (walk, live, map) = (bench.path("walk"), bench.path("live"), bench.path("map"));
    let args = ["demo", "--duration", SECONDS, "--domain", bench.domain.name(), "--record"];
    let args = args.iter().map(std::ffi::OsStr::new);
    bench.run(args.chain([walk.as_os_str(), "-o".as_ref(), live.as_os_str()])).expect_success();

    let (pcap, imu, rig) = (walk.join("lidar.pcap"), walk.join("wt901c.bin"), walk.join("rig.toml"));
    let truth = walk.join("truth.tum");
    bench
        .run([
            "map".as_ref(),
            "--lidar".as_ref(),
            pcap.as_os_str(),
            "--imu".as_ref(),
            imu.as_os_str(),
            "--rig".as_ref(),
            rig.as_os_str(),
            "--truth".as_ref(),
            truth.as_os_str(),
            "-o".as_ref(),
            map.as_os_str(),
        ])
        .expect_success();
    let summary: Value = serde_json::from_str(&bench.text("map/summary.json")).unwrap();
    assert_eq!(summary["frames"], 140);
    assert_eq!(summary["frames_lost"], 0);
    let odometry = &summary["odometry"];
    assert!((100..140).contains(&odometry["poses"].as_u64().unwrap()), "{odometry}");
    assert_eq!(odometry["losses"]["count"], 0, "{odometry}");
    assert!((0.0..1.0).contains(&odometry["degenerate"]["share"].as_f64().unwrap()), "{odometry}");
    assert!(odometry["time_offset_ms"].as_f64().unwrap().abs() < 2.0, "{odometry}");
    assert!(summary["drift"]["end_percent"].as_f64().unwrap() < 2.0, "{}", summary["drift"]);
}

#[test]
fn the_papers_odometry_maps_the_walk_as_well_and_says_so() {
    let bench = Bench::new();
    let path = bench.path("loam");
    let args = ["demo", "--duration", SECONDS, "--domain", bench.domain.name(), "--odometry", "loam", "-o"];
    bench.run(args.iter().map(std::ffi::OsStr::new).chain([path.as_os_str()])).expect_success();
    let summary: Value = serde_json::from_str(&bench.text("loam/summary.json")).unwrap();
    assert_eq!(summary["stages"]["loam"]["frames"]["out"], 140);
    assert!(summary["latency_to_pose"]["count"].as_u64() > Some(0), "{summary}");
    assert!(summary["drift"]["end_percent"].as_f64().unwrap() < 3.0, "{}", summary["drift"]);
}

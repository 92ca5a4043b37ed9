//! Recording and replay with real processes: what was recorded maps as the walk itself did, and other people's tools read it.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use std::path::{Path, PathBuf};

use common::{Bench, Running, wait_for};
use rustix::process::Signal;
use serde_json::Value;

const RIG: &str =
    "[rig.imu_from_lidar]\ntranslation_m = [0.05, -0.02, 0.06]\nroll_pitch_yaw_deg = [0.5, -1.0, 1.5]\n";
const RESULTS: [&str; 6] = ["trajectory.tum", "truth.tum", "map.ot", "map.bt", "plan.pgm", "cloud.pcd"];

/// A pipeline from the simulator to maps in `output`, with a recorder.
fn pipeline(bench: &Bench, mode: &str, output: &str, simulator: &str, recorder: &str) -> PathBuf {
    let domain = bench.domain.name();
    let mut text = format!("mode = \"{mode}\"\ndomain = \"{domain}\"\n{RIG}");
    text += &format!("[[stage]]\nkind = \"simulator\"\n[stage.config]\n{simulator}\n");
    for kind in ["deskewer", "lio", "octree_mapper"] {
        text += &format!("[[stage]]\nkind = \"{kind}\"\n");
    }
    for kind in ["grid_exporter", "map_saver"] {
        text += &format!("[[stage]]\nkind = \"{kind}\"\n[stage.config]\noutput_dir = \"{output}\"\n");
    }
    text += &format!("[[stage]]\nkind = \"recorder\"\n[stage.config]\n{recorder}\n");
    bench.write("recorded.toml", text)
}

fn up(bench: &Bench, pipeline: &Path) {
    bench.run([Path::new("up"), pipeline]).expect_success();
}

fn map(bench: &Bench, recording: &str, more: &[&str], output: &str) -> Value {
    bench.write("rig.toml", RIG);
    let args = ["map", recording, "--rig", "rig.toml", "-o", output];
    bench.run(args.iter().chain(more)).expect_success();
    serde_json::from_str(&bench.text(&format!("{output}/summary.json"))).unwrap()
}

#[track_caller]
fn assert_same(bench: &Bench, a: &str, b: &str) {
    for file in RESULTS {
        assert!(bench.bytes(&format!("{a}/{file}")) == bench.bytes(&format!("{b}/{file}")), "{file} differs");
    }
}

#[test]
fn a_recorded_walk_gives_the_same_poses_and_maps_byte_for_byte_from_one_file_or_several() {
    let bench = Bench::new();
    for (name, limits) in [("one", ""), ("several", "max_file_s = 2.5"), ("raw", "ros = false")] {
        let recorder = format!("output_dir = \"rec\"\nname = \"{name}\"\n{limits}");
        up(&bench, &pipeline(&bench, "lossless", "walk", "duration_s = 8.0", &recorder));
        let summary = map(&bench, &format!("rec/{name}"), &[], name);
        assert_eq!((&summary["frames"], &summary["frames_lost"]), (&80.into(), &0.into()), "{name}");
        assert_same(&bench, "walk", name);
    }
    let files = |name: &str| std::fs::read_dir(bench.path(&format!("rec/{name}"))).unwrap().count();
    assert_eq!(files("one"), 1);
    assert_eq!(files("several"), 4);
    assert_eq!(bench.leftovers(), Vec::<String>::new());
    let taken = bench.run(["up", "recorded.toml"]);
    taken.expect_error(4, &["raw", "there is a recording of that name"]);
}

#[test]
fn a_recording_that_was_killed_is_read_up_to_its_last_chunk() {
    let bench = Bench::new();
    let recorder = "output_dir = \"rec\"\nname = \"cut\"\nchunk_s = 0.5";
    let file = pipeline(&bench, "live", "walk", "duration_s = 60.0", recorder);
    let running = Running::start(bench.evac([Path::new("up"), &file]));
    let recording = bench.path("rec/cut/evac_0.mcap");
    let size = || std::fs::metadata(&recording).map_or(0, |file| file.len());
    wait_for("a few seconds to be on the disk", || (size() > 20_000_000).then_some(()));
    let recorder = wait_for("the recorder's pid", || {
        let status = bench.run(["status", file.to_str().unwrap(), "--json"]);
        serde_json::from_str::<Value>(&status.stdout).ok()?["stages"]["recorder"]["pid"].as_i64()
    });
    let pid = rustix::process::Pid::from_raw(i32::try_from(recorder).unwrap()).unwrap();
    rustix::process::kill_process(pid, Signal::KILL).unwrap();
    assert_ne!(running.end().code, 0, "the pipeline goes on without its recorder");

    let refused = bench.run(["map", "rec/cut", "-o", "refused"]);
    refused.expect_error(4, &["evac_0.mcap", "byte ", "--allow-truncated", "mcap recover"]);
    let whole = map(&bench, "rec/cut", &["--allow-truncated"], "killed")["frames"].as_u64().unwrap();
    assert!(whole >= 10, "{whole} frames");

    // A power cut may end the file anywhere: half a second at most is lost against the whole file.
    let bytes = std::fs::read(&recording).unwrap();
    for cut in [1, 1000, 100_000] {
        std::fs::create_dir_all(bench.path("cut")).unwrap();
        bench.write("cut/evac_0.mcap", &bytes[..bytes.len() - cut]);
        let frames = map(&bench, "cut", &["--allow-truncated"], "shorter")["frames"].as_u64().unwrap();
        assert!(
            (whole.saturating_sub(7)..=whole).contains(&frames),
            "{frames} of {whole} frames, cut by {cut}"
        );
    }
}

#[test]
fn other_peoples_libraries_read_every_message_of_a_recording_and_what_is_left_of_one_that_was_cut() {
    let bench = Bench::new();
    let recorder = "output_dir = \"rec\"\nname = \"walk\"";
    up(&bench, &pipeline(&bench, "lossless", "walk", "duration_s = 4.0", recorder));
    let file = bench.path("rec/walk/evac_0.mcap");
    let Some(read) = evac_testkit::ros_libraries(&["read".as_ref(), &file]) else { return };
    let found: Value = serde_json::from_str(&read.unwrap()).unwrap();
    assert_eq!(found["profile"], "ros2");
    for (topic, kind, count) in [
        ("/lidar/scan", "sensor_msgs/msg/PointCloud2", 40),
        ("/scan/deskewed", "sensor_msgs/msg/PointCloud2", 40),
        ("/imu/sample", "sensor_msgs/msg/Imu", 802),
        ("/odometry/pose", "nav_msgs/msg/Odometry", 40),
        ("/tf", "tf2_msgs/msg/TFMessage", 40),
        ("/truth/pose", "geometry_msgs/msg/PoseStamped", 40),
        ("/map/update", "sensor_msgs/msg/PointCloud2", 40),
        ("/evac/lidar/scan", "std_msgs/msg/UInt8MultiArray", 40),
        ("/evac/imu/sample", "std_msgs/msg/UInt8MultiArray", 802),
    ] {
        for library in ["mcap", "rosbags"] {
            assert_eq!(found[library][format!("{topic} {kind}")], count, "{library} {topic}");
        }
    }
    for topic in ["/grid/plan nav_msgs/msg/OccupancyGrid", "/diagnostics diagnostic_msgs/msg/DiagnosticArray"]
    {
        assert!(found["mcap"][topic].as_u64() > Some(0), "{topic}");
    }
    assert_eq!(found["scan"], serde_json::json!([10_000, 20, ["x", "y", "z", "intensity", "t"]]));
    assert_eq!((&found["pose"][0], &found["pose"][1]), (&"map".into(), &"lidar".into()));
    // The last pose is that of the trajectory file, to its digits.
    let trajectory = bench.text("walk/trajectory.tum");
    let last: Vec<f64> = trajectory.lines().last().unwrap().split(' ').map(|v| v.parse().unwrap()).collect();
    for (axis, value) in last[1..4].iter().enumerate() {
        assert!((found["position"][axis].as_f64().unwrap() - value).abs() < 1e-8, "{found}");
    }
    assert!(found["pose"][2][0].as_f64() > Some(0.0), "no covariance");
    assert_eq!(found["grid"][2], found["grid"][0].as_u64().unwrap() * found["grid"][1].as_u64().unwrap());
    assert!(found["attachments"]["pipeline.toml"].as_str().unwrap().contains("kind = \"recorder\""));
    assert!(found["attachments"]["rig.toml"].as_str().unwrap().contains("translation_m"));

    let bytes = std::fs::read(&file).unwrap();
    let cut = bench.write("cut.mcap", &bytes[..bytes.len() / 2]);
    let salvaged = evac_testkit::ros_libraries(&["salvage".as_ref(), &cut]).unwrap().unwrap();
    let (salvaged, all): (u64, u64) = (
        salvaged.trim().parse().unwrap(),
        found["mcap"].as_object().unwrap().values().map(|count| count.as_u64().unwrap()).sum(),
    );
    assert!((all / 4..all).contains(&salvaged), "{salvaged} of {all} messages");
}

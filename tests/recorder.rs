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
    // The ROS messages are the same scans in another form, whose poses need not be the same to the last bit.
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

//! Recordings replayed in part, at a rate, and scan by scan.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use std::io::Write as _;
use std::time::{Duration, Instant};

use common::{Bench, Running, wait_for};
use serde_json::Value;

const RESULTS: [&str; 5] = ["trajectory.tum", "map.ot", "map.bt", "plan.pgm", "cloud.pcd"];

/// A walk of three seconds as capture and byte log in `walk`, and by evac's own recorder in `rec/walk`.
fn recorded() -> Bench {
    let bench = Bench::new();
    let mut text = format!("mode = \"lossless\"\ndomain = \"{}\"\n", bench.domain.name());
    text += "[[stage]]\nkind = \"simulator\"\n[stage.config]\nduration_s = 3.0\nrecord = \"walk\"\n";
    text += "[[stage]]\nkind = \"recorder\"\n[stage.config]\noutput_dir = \"rec\"\nname = \"walk\"\n";
    text += "services = [\"lidar/scan\", \"imu/sample\"]\n";
    std::fs::create_dir(bench.path("walk")).unwrap();
    bench.write("record.toml", text);
    bench.run(["up", "record.toml"]).expect_success();
    bench
}

const CAPTURE: [&str; 4] = ["--lidar", "walk/lidar.pcap", "--imu", "walk/wt901c.bin"];
const RECORDING: [&str; 1] = ["rec/walk"];

fn frames_out(bench: &Bench, stage: &str) -> Option<u64> {
    let ended = bench.run(["status", "--domain", bench.domain.name(), "--json"]);
    let status: Value = serde_json::from_str(&ended.stdout).ok()?;
    status["stages"][stage]["frames"]["out"].as_u64()
}

#[test]
fn steps_go_scan_by_scan_through_the_whole_pipeline_and_the_files_are_those_of_a_run_without() {
    let bench = recorded();
    for (name, recording) in [("capture", &CAPTURE[..]), ("recording", &RECORDING)] {
        bench.run([["map"].as_slice(), recording, &["-o", "whole"]].concat()).expect_success();
        let stepping = ["-o", name, "--step", "--domain", bench.domain.name()];
        let args = [["map"].as_slice(), recording, &stepping].concat();
        let (running, mut lines) = Running::start_with_input(bench.evac(args));
        let mut step = |line: &str, frames: u64| {
            lines.write_all(line.as_bytes()).unwrap();
            wait_for("the scans to be mapped", || (frames_out(&bench, "map_saver")? >= frames).then_some(()));
            // Nothing follows by itself, as the next report shows.
            std::thread::sleep(Duration::from_millis(1500));
            assert_eq!(frames_out(&bench, "map_saver"), Some(frames), "{name}");
        };
        step("\n", 1);
        step("3\n", 4);
        step("three\n\n", 5);
        drop(lines);
        let ended = running.end().expect_success();
        assert!(ended.stderr.contains("'three' is no number of scans"), "{}", ended.stderr);
        let said: Vec<_> = ended.stdout.lines().filter(|line| line.starts_with("scan ")).collect();
        assert_eq!(said.len(), 30, "{}", ended.stdout);
        assert!(said[4].starts_with("scan 4: 0.400 s to 0.500 s, 10000 points"), "{}", said[4]);
        for file in RESULTS {
            let [a, b] = ["whole", name].map(|folder| bench.bytes(&format!("{folder}/{file}")));
            assert!(a == b, "{name}: {file} differs");
        }
    }
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn a_live_pipeline_file_steps_too_and_no_scan_waits_for_its_imu() {
    let bench = Bench::new();
    let mut text = format!("mode = \"live\"\nstep = true\ndomain = \"{}\"\n", bench.domain.name());
    text += "[[stage]]\nkind = \"simulator\"\n[stage.config]\nduration_s = 60.0\n";
    for kind in ["deskewer", "lio", "octree_mapper"] {
        text += &format!("[[stage]]\nkind = \"{kind}\"\n");
    }
    text += "[[stage]]\nkind = \"map_saver\"\n[stage.config]\noutput_dir = \"out\"\n";
    bench.write("stepped.toml", text);
    let (running, mut lines) = Running::start_with_input(bench.evac(["up", "stepped.toml"]));
    for frames in 1..=3 {
        lines.write_all(b"\n").unwrap();
        wait_for("a scan to be mapped", || (frames_out(&bench, "map_saver")? >= frames).then_some(()));
        // Longer than a scan waits for its IMU samples, and than the next report does.
        std::thread::sleep(Duration::from_millis(1500));
        assert_eq!(frames_out(&bench, "map_saver"), Some(frames));
    }
    let status: Value =
        serde_json::from_str(&bench.run(["status", "--domain", bench.domain.name(), "--json"]).stdout)
            .unwrap();
    let deskewer = &status["stages"]["deskewer"]["frames"];
    assert!(deskewer["late"] == 0 && deskewer["degraded"] == 0, "{status:#}");
    running.signal(rustix::process::Signal::TERM);
    running.end().expect_success();
    let sensors = bench.write("sensors.toml", "step = true\n[[stage]]\nkind = \"imu\"\n");
    bench
        .run(["check", sensors.to_str().unwrap()])
        .expect_error(3, &["step = true", "replay", "sensors do not wait"]);
}

#[test]
fn a_part_of_a_recording_maps_at_the_rate_that_is_asked_for() {
    let bench = recorded();
    for (name, recording) in [("capture", &CAPTURE[..]), ("recording", &RECORDING)] {
        let part = ["--start", "0.5", "--duration", "1.5", "-o", name];
        let started = Instant::now();
        bench.run([["map"].as_slice(), recording, &part, &["--rate", "0.5"]].concat()).expect_success();
        // The first scan ends a tenth of a second after the first sample; a busy machine takes longer.
        let took_s = started.elapsed().as_secs_f64();
        assert!(took_s > (1.5 - 0.1) / 0.5, "{name}: {took_s} s");
        let summary: Value = serde_json::from_str(&bench.text(&format!("{name}/summary.json"))).unwrap();
        let replayed = &summary["stages"]["replay"]["frames"];
        assert_eq!(replayed["out"], 15, "{name}: {summary:#}");
        // Live: what a busy machine does not get through is counted.
        let mapped = summary["frames"].as_u64().unwrap();
        let lost = summary["frames_lost"].as_u64().unwrap();
        assert!(mapped + lost >= 15 && mapped <= 15, "{name}: {mapped} mapped, {lost} lost");
    }
    bench.run(["map", "rec/walk", "--start", "9"]).expect_error(3, &["start_s = 9", "3.0 s", "choose less"]);
}

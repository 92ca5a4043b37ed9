//! Instances beside the one that leads: a shadow that nobody hears, and an old one that goes on when the new one dies at once.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;
#[path = "common/observer.rs"]
mod observer;
#[path = "common/terminal.rs"]
mod terminal;
#[path = "common/walk.rs"]
mod walk;

use std::collections::BTreeSet;
use std::io::{BufRead as _, BufReader};
use std::process::Stdio;

use common::{Bench, Running, wait_for};
use observer::{Heard, Observer, assert_gap_free};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use terminal::Terminal;
use walk::{STAGES, pipeline, status, wait_for_frames};

/// A live walk, running.
fn start_walk(bench: &Bench, seed: u32) -> Running {
    let file = pipeline(bench, "mode = \"live\"", "out", &format!("seed = {seed}\nlaps = 3"));
    Running::start(bench.evac(["up", &file]))
}

/// The outcome of a request that succeeds.
#[track_caller]
fn ask<const N: usize>(bench: &Bench, words: [&str; N]) -> Value {
    let words = words.into_iter().chain(["--json", "--domain", bench.domain.name()]);
    serde_json::from_str(&bench.run(words.collect::<Vec<_>>()).expect_success().stdout).unwrap()
}

/// The reason of one that is refused.
#[track_caller]
fn refusal<const N: usize>(bench: &Bench, words: [&str; N]) -> String {
    let ended = bench.run(words.into_iter().chain(["--domain", bench.domain.name()]).collect::<Vec<_>>());
    assert_ne!(ended.code, 0, "{}", ended.stdout);
    ended.stderr
}

fn kill(pid: i64) {
    kill_process(Pid::from_raw(i32::try_from(pid).unwrap()).unwrap(), Signal::KILL).unwrap();
}

#[track_caller]
fn assert_nothing_lost(status: &Value) {
    for stage in &STAGES[1..] {
        let frames = &status["stages"][stage]["frames"];
        assert_eq!(frames["lost"], 0, "{stage}: {status:#}");
    }
}

/// Every number from the first to the last was there.
#[track_caller]
fn assert_complete(what: &str, seqs: impl IntoIterator<Item = u64>) {
    assert_gap_free(what, seqs.into_iter().collect::<BTreeSet<_>>());
}

#[track_caller]
fn assert_whole(heard: &Heard) {
    assert_gap_free("scan/deskewed", heard.scans.iter().map(|frame| frame.seq));
    assert_gap_free("odometry/pose", heard.poses.iter().map(|pose| pose.frame.seq));
    assert_gap_free("map/update", heard.updates.iter().map(|frame| frame.seq));
    for sink in ["grid_exporter", "map_saver"] {
        assert_gap_free(sink, heard.acks_of(sink));
    }
}

#[test]
fn a_shadow_is_unheard_dies_without_effect_and_is_promoted() {
    let bench = Bench::new();
    let up = start_walk(&bench, 7);
    let before = wait_for_frames(&bench, 30);
    let observer = Observer::start(&bench.domain);
    assert!(refusal(&bench, ["shadow", "map_saver"]).contains("only processors"));
    assert!(refusal(&bench, ["shadow", "--stop", "lio"]).contains("has no shadow"));
    assert!(refusal(&bench, ["promote", "lio"]).contains("has no shadow"));
    // One that is killed.
    let first = ask(&bench, ["shadow", "lio", "--kind", "loam"]);
    assert!(first["kind"] == "loam" && first["epoch"] == 1, "{first}");
    assert!(refusal(&bench, ["shadow", "lio"]).contains("already"));
    let beside = wait_for("the shadow to put out frames", || {
        let status = status(&bench)?;
        let beside = status["stages"]["lio"]["standbys"][0].clone();
        (beside["frames"]["out"].as_u64() > Some(10)).then_some(beside)
    });
    assert!(beside["state"] == "shadow" && beside["pid"] == first["pid"], "{beside:#}");
    kill(first["pid"].as_i64().unwrap());
    wait_for("the shadow to be gone", || {
        let status = status(&bench)?;
        (status["stages"]["lio"]["standbys"] == Value::Array(Vec::new())).then_some(())
    });
    // One that is ended, of every processor.
    for stage in ["deskewer", "octree_mapper"] {
        let shadow = ask(&bench, ["shadow", stage]);
        let ended = ask(&bench, ["shadow", "--stop", stage]);
        assert_eq!(shadow["pid"], ended["pid"], "{stage}");
    }
    // And one that takes over.
    ask(&bench, ["shadow", "lio", "--kind", "loam"]);
    let promoted = ask(&bench, ["promote", "odometry"]);
    assert!(promoted["kind"] == "loam" && promoted["from_seq"].as_u64() > Some(0), "{promoted}");
    let after = wait_for("the promoted one to lead alone", || {
        let status = wait_for_frames(&bench, 5);
        (status["stages"]["lio"]["standbys"] == Value::Array(Vec::new())).then_some(status)
    });
    assert_eq!(after["stages"]["lio"]["pid"], promoted["pid"], "{after:#}");
    for stage in ["deskewer", "octree_mapper", "map_saver"] {
        assert_eq!(after["stages"][stage]["pid"], before["stages"][stage]["pid"], "{stage}");
    }
    assert_nothing_lost(&after);
    assert_whole(&observer.stop());
    up.signal(Signal::TERM);
    up.end().expect_success();
    assert_eq!(bench.leftovers(), Vec::<String>::new());
    assert!(!bench.domain.of_shadows().unwrap().folder().exists());
}

#[test]
fn where_the_new_instance_dies_of_its_first_frames_the_old_one_goes_on() {
    let bench = Bench::new();
    let up = start_walk(&bench, 8);
    let before = wait_for_frames(&bench, 30);
    let observer = Observer::start(&bench.domain);
    for stage in ["lio", "deskewer", "octree_mapper", "map_saver"] {
        let mut swap = bench
            .evac(["swap", stage, "--domain", bench.domain.name()])
            .stderr(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (mut pid, mut said) = (None, String::new());
        for line in BufReader::new(swap.stderr.take().unwrap()).lines() {
            let line = line.unwrap();
            if let Some((_, number)) = line.split_once("starts, pid ") {
                pid = number.parse().ok();
            }
            if line.contains("leads from frame") {
                kill(pid.unwrap());
            }
            said += &format!("{line}\n");
        }
        assert!(!swap.wait().unwrap().success(), "{stage}: {said}");
        assert!(said.contains("leads from frame") && said.contains("the old instance goes on"), "{said}");
    }
    let frames = before["stages"]["map_saver"]["frames"]["out"].as_u64().unwrap();
    let after = wait_for_frames(&bench, frames + 30);
    for stage in STAGES {
        let (now, then) = (&after["stages"][stage], &before["stages"][stage]);
        assert_eq!(now["pid"], then["pid"], "{stage}: {after:#}");
        assert_eq!(now["standbys"], Value::Array(Vec::new()), "{stage}");
    }
    assert_nothing_lost(&after);
    let heard = observer.stop();
    assert_complete("scan/deskewed", heard.scans.iter().map(|frame| frame.seq));
    assert_complete("odometry/pose", heard.poses.iter().map(|pose| pose.frame.seq));
    assert_complete("map/update", heard.updates.iter().map(|frame| frame.seq));
    assert_complete("map_saver", heard.acks_of("map_saver"));
    up.signal(Signal::TERM);
    up.end().expect_success();
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn a_stage_and_its_shadow_are_compared_and_equal_ones_hardly_differ() {
    let bench = Bench::new();
    let up = start_walk(&bench, 9);
    wait_for_frames(&bench, 30);
    let domain = bench.domain.name().to_owned();
    let compared = |stage: &str| -> Value {
        let folder = bench.path(stage);
        let words = ["compare", stage, "--duration", "4", "--json", "--domain", &domain, "-o"];
        let ended = bench.run(words.into_iter().chain([folder.to_str().unwrap()])).expect_success();
        let json: Value = serde_json::from_str(&ended.stdout).unwrap();
        let file: Value = serde_json::from_slice(&bench.bytes(&format!("{stage}/compare.json"))).unwrap();
        assert_eq!(json, file, "{stage}");
        assert!(bench.bytes(&format!("{stage}/compare.png")).starts_with(b"\x89PNG"), "{stage}");
        // Without a terminal there is no table in place, but a line.
        assert!(ended.stderr.contains("frame ") && !ended.stderr.contains('\x1b'), "{}", ended.stderr);
        assert!(json["frames"].as_u64() > Some(5), "{json}");
        for side in ["a", "b"] {
            // The kernel counts in ticks of 10 ms; a deskewer needs none in some seconds.
            let cpu = json[side]["cpu_percent"].as_f64().unwrap();
            assert!(cpu > 0.0 || cpu == 0.0 && stage == "deskewer", "{stage}: {}", json[side]);
            assert!(json["latency"][format!("{side}_ms")]["median"].as_f64() > Some(0.0), "{stage}");
        }
        json
    };
    assert!(refusal(&bench, ["compare", "lio"]).contains("has no shadow"));
    for stage in ["deskewer", "octree_mapper"] {
        ask(&bench, ["shadow", stage]);
        let json = compared(stage);
        // A scan whose prior came too late for one of them differs a little.
        let key = if stage == "deskewer" { "points_rms_mm" } else { "share_percent" };
        let median = json["deviation"][key]["median"].as_f64().unwrap();
        assert!(median < 0.5, "{stage}: {}", json["deviation"]);
        ask(&bench, ["shadow", "--stop", stage]);
    }
    ask(&bench, ["shadow", "lio", "--kind", "loam"]);
    let json = compared("lio");
    assert!(json["a"]["name"] == "lio" && json["b"]["name"] == "loam #1", "{} {}", json["a"], json["b"]);
    let off = json["deviation"]["position_mm"]["max"].as_f64().unwrap();
    // Two methods differ, but both are in one map frame.
    assert!(off > 0.0 && off < 1000.0, "{}", json["deviation"]);
    up.signal(Signal::TERM);
    up.end().expect_success();
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn on_a_terminal_the_comparison_is_one_table_that_is_written_again_in_place() {
    let bench = Bench::new();
    let up = start_walk(&bench, 10);
    wait_for_frames(&bench, 5);
    ask(&bench, ["shadow", "octree_mapper"]);
    // In the second the lines of the table are longer than those of the terminal.
    for columns in [100, 50] {
        let compare = bench.evac(["compare", "octree_mapper", "--domain", bench.domain.name()]);
        let mut terminal = Terminal::start(compare, (30, columns));
        let frames = |screen: &str| {
            let words: Vec<_> = screen.split_whitespace().collect();
            let at = words.iter().position(|word| *word == "frames")?;
            words[at - 1].parse::<u64>().ok()
        };
        let mut shown = 0;
        for _ in 0..3 {
            let screen = terminal.wait_for("the next table", |screen| frames(screen) > Some(shown));
            shown = frames(&screen).unwrap();
        }
        let screen =
            terminal.wait_for("a whole table", |screen| screen.contains("CPU (%), octree_mapper #1"));
        assert_eq!(screen.matches(" beside ").count(), 1, "{columns} columns:\n{screen}");
        terminal.signal(Signal::TERM);
        assert_eq!(terminal.end(), 0);
    }
    up.signal(Signal::TERM);
    up.end().expect_success();
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn two_odometries_are_compared_over_a_recording() {
    let bench = Bench::new();
    let (recording, out) = (bench.path("recording"), bench.path("out"));
    let (folder, out) = (recording.to_str().unwrap(), out.to_str().unwrap());
    let demo = ["demo", "--duration", "8", "--record", folder, "-o", out, "--domain", bench.domain.name()];
    bench.run(demo).expect_success();
    let file = |name: &str| recording.join(name).to_str().unwrap().to_owned();
    let (lidar, imu, rig) = (file("lidar.pcap"), file("wt901c.bin"), file("rig.toml"));
    let compare = ["compare", &lidar, "--imu", &imu, "--rig", &rig, "--a", "lio", "--b", "loam", "-o", out];
    let ended = bench.run(compare).expect_success();
    for words in ["lio beside loam", "position (mm)", "computing (ms), loam", "CPU (%), lio"] {
        assert!(ended.stdout.contains(words), "no '{words}' in\n{}", ended.stdout);
    }
    let json: Value = serde_json::from_slice(&bench.bytes("out/compare.json")).unwrap();
    assert!(json["frames"].as_u64() > Some(60), "{}", json["frames"]);
    assert!(json["deviation"]["position_mm"]["max"].as_f64() > Some(0.0), "{}", json["deviation"]);
    let refused = bench.run(["compare", &lidar]);
    assert!(refused.code != 0 && refused.stderr.contains("--a lio --b loam"), "{}", refused.stderr);
}

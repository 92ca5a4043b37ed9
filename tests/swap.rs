//! Stages are swapped, and die, while a simulated walk goes on: no frame is lost and none comes twice.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;
#[path = "common/observer.rs"]
mod observer;
#[path = "common/walk.rs"]
mod walk;

use std::path::Path;

use common::{Bench, Ended, Running, wait_for};
use observer::{Heard, Observer, assert_gap_free};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use walk::{STAGES, pipeline, status, wait_for_frames};

/// No pose is farther off at a cut, metres and radians.
const MAX_JUMP: (f64, f64) = (0.02, 0.0035);

fn ask<const N: usize>(bench: &Bench, words: [&str; N]) -> Ended {
    let words = words.into_iter().chain(["--json", "--domain", bench.domain.name()]);
    bench.run(words.collect::<Vec<_>>())
}

/// The outcome of a request that succeeds.
#[track_caller]
fn swap<const N: usize>(bench: &Bench, words: [&str; N]) -> Value {
    serde_json::from_str(&ask(bench, words).expect_success().stdout).unwrap()
}

fn kill(pid: &Value) {
    let pid = i32::try_from(pid.as_i64().unwrap()).unwrap();
    kill_process(Pid::from_raw(pid).unwrap(), Signal::KILL).unwrap();
}

/// Nothing was lost and nothing came twice, on any stream and at any sink.
#[track_caller]
fn assert_whole(heard: &Heard, status: &Value) {
    assert_gap_free("scan/deskewed", heard.scans.iter().map(|frame| frame.seq));
    assert_gap_free("odometry/pose", heard.poses.iter().map(|pose| pose.frame.seq));
    assert_gap_free("map/update", heard.updates.iter().map(|frame| frame.seq));
    for sink in ["grid_exporter", "map_saver"] {
        assert_gap_free(sink, heard.acks_of(sink));
    }
    for stage in &STAGES[1..] {
        let frames = &status["stages"][stage]["frames"];
        assert!(frames["lost"] == 0, "{stage}: {status:#}");
        // On a machine that is busy enough a live scan waits longer than 0.2 s for its IMU samples, swapped or not.
        println!("{stage}: {} late", frames["late"]);
    }
}

#[track_caller]
fn assert_no_jump(heard: &Heard, cuts: usize) {
    let jumps = heard.jumps();
    assert_eq!(jumps.len(), cuts, "{jumps:?}");
    for (seq, way, turn) in jumps {
        println!("frame {seq}: {:.1} mm, {:.3} degrees off at the cut", way * 1e3, turn.to_degrees());
        assert!(way < MAX_JUMP.0 && turn < MAX_JUMP.1, "frame {seq}: {way} m, {turn} rad");
    }
}

#[test]
fn every_processor_and_consumer_is_swapped_in_a_live_walk_without_loss_repetition_or_jump() {
    let bench = Bench::new();
    let file = pipeline(&bench, "mode = \"live\"", "live", "seed = 3");
    let up = Running::start(bench.evac(["up", &file]));
    wait_for_frames(&bench, 40);
    let observer = Observer::start(&bench.domain);
    let loam = swap(&bench, ["swap", "lio", "--kind", "loam"]);
    assert!(loam["kind"] == "loam" && loam["epoch"] == 1, "{loam}");
    for stage in ["deskewer", "grid_exporter", "map_saver", "octree_mapper"] {
        let outcome = swap(&bench, ["swap", stage]);
        println!("{outcome}");
        assert_eq!(outcome["epoch"], 1, "{outcome}");
    }
    let lio = swap(&bench, ["swap", "odometry", "--kind", "lio"]);
    assert!(lio["kind"] == "lio" && lio["epoch"] == 2, "{lio}");
    let status = wait_for_frames(&bench, 5);
    for (stage, epoch) in [("deskewer", 1), ("lio", 2), ("map_saver", 1)] {
        assert_eq!(status["stages"][stage]["epoch"], epoch, "{status:#}");
        assert_eq!(status["stages"][stage]["standbys"], Value::Array(Vec::new()), "{status:#}");
    }
    let heard = observer.stop();
    println!("longest gap of the pose stream: {:.0} ms", heard.longest_gap_s() * 1e3);
    assert_whole(&heard, &status);
    assert_no_jump(&heard, 2);
    up.signal(Signal::TERM);
    up.end().expect_success();
    // The whole walk is in the files, not only the last instances' part.
    let poses =
        bench.text("live/trajectory.tum").lines().filter(|line| !line.starts_with('#')).count() as u64;
    let frames = heard.poses.last().unwrap().frame.seq + 1;
    assert!(poses >= frames, "{poses} of {frames}");
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn a_standby_takes_over_when_the_one_that_leads_is_killed_and_nothing_is_lost() {
    let bench = Bench::new();
    let file = pipeline(&bench, "mode = \"live\"", "live", "seed = 4");
    let up = Running::start(bench.evac(["up", &file]));
    wait_for_frames(&bench, 40);
    let observer = Observer::start(&bench.domain);
    let mut cuts = 0;
    for stage in ["deskewer", "lio", "octree_mapper", "grid_exporter", "map_saver"] {
        let standby = swap(&bench, ["standby", stage]);
        let before = wait_for("the standby in the status", || {
            let status = status(&bench)?;
            (status["stages"][stage]["standbys"][0]["pid"] == standby["pid"]).then_some(status)
        });
        kill(&before["stages"][stage]["pid"]);
        wait_for("the standby to lead", || {
            let status = status(&bench)?;
            let led = &status["stages"][stage];
            (led["pid"] == standby["pid"] && led["frames"]["out"].as_u64() > Some(3)).then_some(())
        });
        cuts += usize::from(stage == "lio");
    }
    let status = wait_for_frames(&bench, 5);
    let mut heard = observer.stop();
    println!("longest gap of the pose stream: {:.0} ms", heard.longest_gap_s() * 1e3);
    // What a killed instance put out last is put out once more, for whoever it did not reach.
    // Both copies come in any order; the step that it made is the killed one's.
    heard.poses.sort_by_key(|pose| (pose.frame.seq, pose.frame.epoch));
    heard.scans.sort_by_key(|frame| frame.seq);
    heard.updates.sort_by_key(|frame| frame.seq);
    heard.scans.dedup_by_key(|frame| frame.seq);
    heard.poses.dedup_by_key(|pose| pose.frame.seq);
    heard.updates.dedup_by_key(|frame| frame.seq);
    let mut seen = std::collections::BTreeSet::new();
    heard.acks.retain(|ack| seen.insert((ack.name, ack.seq)));
    assert_whole(&heard, &status);
    assert_no_jump(&heard, cuts);
    up.signal(Signal::TERM);
    up.end().expect_success();
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn an_instance_that_dies_hangs_or_is_wrong_leaves_the_old_one_as_it_was() {
    let bench = Bench::new();
    let file = pipeline(&bench, "mode = \"live\"", "live", "seed = 5");
    let up = Running::start(bench.evac(["up", &file]));
    let before = wait_for_frames(&bench, 10);
    let observer = Observer::start(&bench.domain);
    let deaf = bench.write("deaf.sh", "#!/bin/sh\nsleep 1000\n");
    let dead = bench.write("dead.sh", "#!/bin/sh\nexit 4\n");
    for script in [&deaf, &dead] {
        use std::os::unix::fs::PermissionsExt as _;
        std::fs::set_permissions(script, std::fs::Permissions::from_mode(0o755)).unwrap();
    }
    let refused = |words: &[&str], reason: &[&str]| {
        // What follows --run is the executable's.
        let (command, rest) = words.split_first().unwrap();
        let ended = bench.run([&[*command, "--domain", bench.domain.name()], rest].concat());
        assert_ne!(ended.code, 0, "{}", ended.stderr);
        assert!(reason.iter().all(|word| ended.stderr.contains(word)), "{}", ended.stderr);
    };
    let path = |path: &Path| path.to_str().unwrap().to_owned();
    refused(&["swap", "lio", "--patience", "2", "--run", &path(&deaf)], &["said nothing", "goes on"]);
    refused(&["swap", "lio", "--run", &path(&dead)], &["code 4", "goes on"]);
    refused(&["swap", "lio", "--run", "/nowhere/lio"], &["/nowhere/lio"]);
    refused(&["swap", "lio", "--kind", "deskewer"], &["odometry/pose"]);
    refused(&["standby", "simulator"], &["producer"]);
    refused(&["swap", "walker"], &["walker", "octree_mapper"]);
    let other = bench
        .write("other.toml", "[[stage]]\nkind = \"octree_mapper\"\n[stage.config]\nresolution_m = 0.2\n");
    refused(&["swap", "octree_mapper", "--config", &path(&other)], &["0.2", "goes on"]);
    let status = wait_for_frames(&bench, 15);
    for stage in STAGES {
        assert_eq!(status["stages"][stage]["pid"], before["stages"][stage]["pid"], "{stage}");
        assert_eq!(status["stages"][stage]["standbys"], Value::Array(Vec::new()), "{stage}");
    }
    assert_whole(&observer.stop(), &status);
    up.signal(Signal::TERM);
    up.end().expect_success();
}

#[test]
fn a_lossless_walk_with_swaps_of_mapper_and_sinks_ends_with_the_same_files() {
    let bench = Bench::new();
    let walk = "seed = 6\nlaps = 3\nduration_s = 120.0";
    let whole = pipeline(&bench, "mode = \"lossless\"", "whole", walk);
    Running::start(bench.evac(["up", &whole])).end().expect_success();
    // 40 s at least, however fast the machine is: three swaps must come before the end.
    let swapped = pipeline(&bench, "mode = \"lossless\"\nrate = 3.0", "swapped", walk);
    let up = Running::start(bench.evac(["up", &swapped]));
    wait_for("the first frames", || {
        let status = status(&bench)?;
        (status["stages"]["map_saver"]["frames"]["out"].as_u64() > Some(30)).then_some(())
    });
    for stage in ["octree_mapper", "map_saver", "grid_exporter"] {
        println!("{}", swap(&bench, ["swap", stage]));
    }
    up.end().expect_success();
    for file in ["map.ot", "map.bt", "trajectory.tum", "cloud.pcd", "plan.pgm"] {
        let [a, b] = ["whole", "swapped"].map(|folder| bench.bytes(&format!("{folder}/{file}")));
        assert!(a == b, "{file} differs");
    }
}

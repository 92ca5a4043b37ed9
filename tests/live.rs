//! `evac up`, `status` and `down`: a live pipeline, its processes and what they leave behind.
#![allow(clippy::unwrap_used)]

mod common;

use std::path::Path;

use common::{Bench, Running, wait_for};
use rustix::process::Signal;
use serde_json::Value;

const STAGES: [&str; 6] = ["simulator", "deskewer", "lio", "octree_mapper", "grid_exporter", "map_saver"];

/// A live pipeline that goes on for a minute if it is not stopped.
fn pipeline(bench: &Bench) -> String {
    let mut text = format!("mode = \"live\"\ndomain = \"{}\"\n", bench.domain.name());
    for stage in STAGES {
        text += &format!("[[stage]]\nkind = \"{stage}\"\n");
        if stage == "grid_exporter" || stage == "map_saver" {
            text += &format!("[stage.config]\noutput_dir = \"{}\"\n", bench.path("").display());
        }
    }
    bench.write("live.toml", text).to_str().unwrap().to_owned()
}

/// Waits until every stage has put out frames and gives the status.
fn running_status(bench: &Bench, file: &str) -> Value {
    wait_for("all stages to put out frames", || {
        let ended = bench.run(["status", file, "--json"]);
        let status: Value = serde_json::from_str(&ended.stdout).ok()?;
        let all = STAGES.iter().all(|stage| status["stages"][stage]["frames"]["out"].as_u64() > Some(3));
        all.then_some(status)
    })
}

fn pids(status: &Value) -> Vec<i64> {
    STAGES.iter().map(|stage| status["stages"][stage]["pid"].as_i64().unwrap()).collect()
}

fn assert_gone(pids: &[i64]) {
    for pid in pids {
        wait_for("a stage to end", || {
            // A zombie that waits for init has ended too.
            let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
            (status.is_empty() || status.contains("State:\tZ")).then_some(())
        });
    }
}

#[test]
fn status_shows_every_process_and_sigterm_ends_them_all_and_writes_the_maps() {
    let bench = Bench::new();
    let file = pipeline(&bench);
    let up = Running::start(bench.evac(["up", &file]));
    let status = running_status(&bench, &file);
    let mut pids = pids(&status);
    for stage in STAGES {
        let stage = &status["stages"][stage];
        assert_eq!(stage["state"], "running");
        assert!(Path::new(&format!("/proc/{}", stage["pid"])).exists());
        assert!(stage["rate_hz"].as_f64().unwrap() > 1.0, "{stage}");
        assert_eq!(stage["frames"]["lost"], 0, "{stage}");
    }
    let tracked = wait_for("the first poses", || {
        let status: Value =
            serde_json::from_str(&bench.run(["status", "--json", &file]).expect_success().stdout).unwrap();
        let odometry = status["stages"]["lio"]["odometry"].clone();
        odometry.is_object().then_some(odometry)
    });
    assert!(["tracking", "degenerate"].contains(&tracked["state"].as_str().unwrap()), "{tracked}");
    assert_eq!(tracked["losses"], serde_json::json!({ "count": 0, "frames": 0, "lost_now": false }));
    assert!(tracked["quality"].as_f64().unwrap() > 0.3, "{tracked}");
    assert!(tracked["time_offset_sigma_ms"].as_f64().unwrap() > 0.0, "{tracked}");
    assert!(status["stages"]["deskewer"]["odometry"].is_null(), "{status}");
    let table = bench.run(["status", &file]).expect_success().stdout;
    assert!(table.contains("% of frames"), "{table}");
    assert!(STAGES.iter().all(|stage| table.contains(stage)), "{table}");
    pids.sort_unstable();
    pids.dedup();
    assert_eq!(pids.len(), STAGES.len(), "every stage is a process of its own");

    up.signal(Signal::TERM);
    up.end().expect_success();
    assert_gone(&pids);
    assert_eq!(bench.leftovers(), Vec::<String>::new());
    for file in ["map.ot", "map.bt", "plan.pgm", "plan.png", "trajectory.tum", "cloud.pcd"] {
        assert!(!bench.bytes(file).is_empty(), "{file}");
    }
}

#[test]
fn down_stops_what_up_started_and_a_second_up_is_refused() {
    let bench = Bench::new();
    let file = pipeline(&bench);
    let up = Running::start(bench.evac(["up", &file]));
    running_status(&bench, &file);
    bench.run(["up", &file]).expect_error(5, &["in use", "--domain"]);
    let down = bench.run(["down", &file]).expect_success();
    assert!(down.stdout.contains("is down"));
    up.end().expect_success();
    assert_eq!(bench.leftovers(), Vec::<String>::new());
    bench.run(["down", &file]).expect_error(5, &["no pipeline runs", "evac up"]);
    bench.run(["status", &file]).expect_error(5, &["no pipeline runs", "evac up"]);
}

#[test]
fn no_stage_outlives_a_killed_launcher_and_the_next_one_cleans_up() {
    let bench = Bench::new();
    let file = pipeline(&bench);
    let up = Running::start(bench.evac(["up", &file]));
    let pids = pids(&running_status(&bench, &file));
    up.signal(Signal::KILL);
    assert_eq!(up.end().code, -1);
    assert_gone(&pids);

    let up = Running::start(bench.evac(["up", &file]));
    running_status(&bench, &file);
    up.signal(Signal::INT);
    up.end().expect_success();
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn a_stage_that_dies_is_started_again_but_not_for_ever_and_then_ends_the_pipeline_with_its_name() {
    let bench = Bench::new();
    let file = pipeline(&bench);
    let up = Running::start(bench.evac(["up", &file]));
    let status = running_status(&bench, &file);
    let mut killed = Value::Null;
    for epoch in 0..4 {
        let lio = wait_for("lio to run again", || {
            let status: Value = serde_json::from_str(&bench.run(["status", "--json", &file]).stdout).ok()?;
            let lio = status["stages"]["lio"].clone();
            (lio["state"] == "running" && lio["epoch"] == epoch && lio["pid"] != killed).then_some(lio)
        });
        killed = lio["pid"].clone();
        let pid = i32::try_from(killed.as_i64().unwrap()).unwrap();
        rustix::process::kill_process(rustix::process::Pid::from_raw(pid).unwrap(), Signal::KILL).unwrap();
    }
    let ended = up.end();
    assert_eq!(ended.code, 1);
    assert!(ended.stderr.contains("'lio'") && ended.stderr.contains("signal 9"), "{}", ended.stderr);
    assert_gone(&pids(&status));
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn the_robot_s_boot_script_starts_a_pipeline_and_sigterm_ends_it() {
    let bench = Bench::new();
    let file = pipeline(&bench);
    let robot = |file: &str| {
        let mut command = std::process::Command::new(concat!(env!("CARGO_MANIFEST_DIR"), "/launch/robot.sh"));
        command.arg(file).env("EVAC", env!("CARGO_BIN_EXE_evac"));
        Running::start(command)
    };
    let running = robot(&file);
    let pids = pids(&running_status(&bench, &file));
    running.signal(Signal::TERM);
    running.end().expect_success();
    assert_gone(&pids);
    assert_eq!(bench.leftovers(), Vec::<String>::new());

    // What cannot work is said once instead of being started for ever.
    let wrong = bench.write("wrong.toml", "mode = \"slow\"");
    let ended = robot(wrong.to_str().unwrap()).end();
    assert_eq!(ended.code, 3, "{}", ended.stderr);
}

#[test]
fn the_commands_of_the_systemd_unit_start_a_pipeline_and_sigterm_ends_it() {
    let bench = Bench::new();
    let file = pipeline(&bench);
    let unit = include_str!("../launch/systemd/evac.service");
    let command = |key: &str| {
        let line = unit.lines().find_map(|line| line.strip_prefix(key)).unwrap();
        let words = line.strip_prefix("/usr/local/bin/evac ").unwrap();
        bench.evac(words.replace("/etc/evac/pipeline.toml", &file).split(' '))
    };
    Running::start(command("ExecStartPre=")).end().expect_success();
    let running = Running::start(command("ExecStart="));
    let pids = pids(&running_status(&bench, &file));
    running.signal(Signal::TERM);
    let ended = running.end().expect_success();
    assert!(ended.stderr.lines().all(|line| serde_json::from_str::<Value>(line).is_ok()), "{}", ended.stderr);
    assert_gone(&pids);
}

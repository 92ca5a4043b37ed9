//! Stages are stopped and killed without a standby: what the launcher notices, says and mends.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::{Bench, Running, wait_for};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

const STAGES: [&str; 6] = ["simulator", "deskewer", "lio", "octree_mapper", "grid_exporter", "map_saver"];

/// A pipeline of the simulator with results in `folder` and `more` at the top of its file.
fn pipeline(bench: &Bench, mode: &str, folder: &str, simulator: &str, more: &str) -> String {
    let mut text = format!("mode = \"{mode}\"\ndomain = \"{}\"\n{more}\n", bench.domain.name());
    for stage in STAGES {
        text += &format!("[[stage]]\nkind = \"{stage}\"\n");
        match stage {
            "simulator" => text += &format!("[stage.config]\n{simulator}\n"),
            "grid_exporter" | "map_saver" => {
                text += &format!("[stage.config]\noutput_dir = \"{}\"\n", bench.path(folder).display());
            }
            _ => {}
        }
    }
    bench.write(&format!("{folder}.toml"), text).to_str().unwrap().to_owned()
}

fn status(bench: &Bench) -> Option<Value> {
    let ended = bench.run(["status", "--domain", bench.domain.name(), "--json"]);
    serde_json::from_str(&ended.stdout).ok()
}

/// Waits until the leading instance of every stage has put out `frames`.
fn wait_for_frames(bench: &Bench, frames: u64) -> Value {
    wait_for("all stages to put out frames", || {
        let status = status(bench)?;
        let all = STAGES.iter().all(|stage| status["stages"][stage]["frames"]["out"].as_u64() > Some(frames));
        all.then_some(status)
    })
}

fn signal(pid: &Value, signal: Signal) {
    let pid = i32::try_from(pid.as_i64().unwrap()).unwrap();
    kill_process(Pid::from_raw(pid).unwrap(), signal).unwrap();
}

/// Waits until a new instance of the stage has put out frames, and gives what the launcher said of the old one's end.
fn wait_for_another(bench: &Bench, stage: &str, before: &Value) -> Value {
    wait_for("a new instance with frames", || {
        let status = status(bench)?;
        let led = &status["stages"][stage];
        let is_new =
            led["epoch"].as_u64() > before["epoch"].as_u64() && led["frames"]["out"].as_u64() > Some(3);
        let incident =
            status["incidents"].as_array()?.iter().rev().find(|incident| incident["stage"] == stage)?;
        (is_new && !incident["resumed"].is_null()).then(|| incident.clone())
    })
}

#[test]
fn a_stage_that_hangs_is_started_again_and_status_and_log_say_why() {
    let bench = Bench::new();
    let file = pipeline(&bench, "live", "live", "seed = 3", "[supervision]\nhang_after_frames = 20");
    let up = Running::start(bench.evac(["up", &file]));
    for stage in ["lio", "deskewer", "octree_mapper", "map_saver"] {
        let before = wait_for_frames(&bench, 10)["stages"][stage].clone();
        signal(&before["pid"], Signal::STOP);
        let incident = wait_for_another(&bench, stage, &before);
        let cause = incident["cause"].as_str().unwrap();
        assert!(
            cause.contains(stage) && cause.contains("hangs") && cause.contains("its last frame is"),
            "{cause}"
        );
        let table = bench.run(["status", "--domain", bench.domain.name()]).expect_success().stdout;
        assert!(table.contains(cause) && table.contains("started again"), "{table}");
        println!("{stage}: {cause}; {}", incident["resumed"]);
    }
    up.signal(Signal::TERM);
    let ended = up.end().expect_success();
    assert_eq!(ended.stderr.matches("hangs: ").count(), 4, "{}", ended.stderr);
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

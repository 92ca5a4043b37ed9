//! The example stages, in Rust and in Python, are swapped into a walk and out again: no frame is lost and none comes twice.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;
#[path = "common/observer.rs"]
mod observer;

use std::path::{Path, PathBuf};
use std::process::Command;

use common::{Bench, Running, wait_for};
use observer::{Observer, assert_gap_free};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// A walk in real time that lasts until it is ended.
fn pipeline(bench: &Bench) -> String {
    let mut text = format!("mode = \"live\"\ndomain = \"{}\"\n", bench.domain.name());
    for stage in ["simulator", "deskewer", "lio", "octree_mapper", "grid_exporter"] {
        text += &format!("[[stage]]\nkind = \"{stage}\"\n");
        match stage {
            "simulator" => text += "[stage.config]\nseed = 3\nlaps = 100\n",
            "grid_exporter" => text += "[stage.config]\noutput_dir = \"maps\"\n",
            _ => {}
        }
    }
    bench.write("walk.toml", text).to_str().unwrap().to_owned()
}

fn deskewer(bench: &Bench) -> Option<Value> {
    let ended = bench.run(["status", "--domain", bench.domain.name(), "--json"]);
    let status: Value = serde_json::from_str(&ended.stdout).ok()?;
    Some(status["stages"]["deskewer"].clone())
}

/// Waits until instance `epoch` leads and has put out some frames.
fn wait_for_frames(bench: &Bench, epoch: u32) -> Value {
    wait_for("the deskewer's frames", || {
        let stage = deskewer(bench)?;
        (stage["epoch"] == epoch && stage["frames"]["out"].as_u64() > Some(10)).then_some(stage)
    })
}

/// Swaps `run` in for the deskewer, and the deskewer in again.
fn swaps_in_and_out(run: &[&str]) {
    let bench = Bench::new();
    let up = Running::start(bench.evac(["up", &pipeline(&bench)]));
    wait_for_frames(&bench, 0);
    let observer = Observer::start(&bench.domain);
    let swap = ["swap", "deskewer", "--json", "--domain", bench.domain.name(), "--run"];
    println!("{}", bench.run(swap.iter().chain(run)).expect_success().stdout);
    let example = wait_for_frames(&bench, 1);
    assert_eq!((&example["state"], &example["route"]["epoch"]), (&"running".into(), &1.into()), "{example}");
    assert_eq!((&example["frames"]["lost"], &example["standbys"]), (&0.into(), &Value::Array(Vec::new())));
    assert!(example["latency"]["compute"]["p50_ms"].as_f64().unwrap() > 0.0, "{example}");
    let evac = env!("CARGO_BIN_EXE_evac");
    let back = [evac, "stage", "deskewer"];
    println!("{}", bench.run(swap.iter().chain(&back)).expect_success().stdout);
    wait_for_frames(&bench, 2);
    let heard = observer.stop();
    // Every scan once, from all three instances in turn.
    assert_gap_free("scan/deskewed", heard.scans.iter().map(|frame| frame.seq));
    let mut epochs: Vec<_> = heard.scans.iter().map(|frame| frame.epoch).collect();
    epochs.dedup();
    assert_eq!(epochs, [0, 1, 2]);
    assert_gap_free("odometry/pose", heard.poses.iter().map(|pose| pose.frame.seq));
    up.signal(Signal::TERM);
    up.end().expect_success();
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn the_rust_example_is_swapped_in_and_out_without_loss() {
    let example = Path::new(env!("CARGO_BIN_EXE_evac")).with_file_name("examples").join("thin_scans");
    // `cargo test` has built it; where the tests of one file alone are run, nobody has.
    let written = |path: &Path| std::fs::metadata(path).and_then(|metadata| metadata.modified()).ok();
    if written(&example) < written(&Path::new(ROOT).join("examples/thin_scans.rs")) {
        let built = Command::new(env!("CARGO"))
            .args(["build", "--offline", "--example", "thin_scans"])
            .args(if cfg!(debug_assertions) { &[][..] } else { &["--release"][..] })
            .current_dir(ROOT)
            .status()
            .unwrap();
        assert!(built.success());
    }
    swaps_in_and_out(&[example.to_str().unwrap()]);
}

/// The Python of `examples/python/setup`; none where that has not been run.
fn python() -> Option<PathBuf> {
    let python = Path::new(ROOT).join("target/python-venv/bin/python");
    if python.exists() {
        return Some(python);
    }
    println!("skipped: examples/python/setup has not been run");
    None
}

#[test]
fn the_python_example_is_swapped_in_and_out_without_loss() {
    let Some(python) = python() else { return };
    let script = Path::new(ROOT).join("examples/python/stage.py");
    swaps_in_and_out(&[python.to_str().unwrap(), script.to_str().unwrap(), "--voxel", "0.01"]);
}

#[test]
fn the_python_example_takes_over_when_the_deskewer_is_killed_and_nothing_is_lost() {
    let Some(python) = python() else { return };
    let script = Path::new(ROOT).join("examples/python/stage.py");
    let bench = Bench::new();
    let up = Running::start(bench.evac(["up", &pipeline(&bench)]));
    wait_for_frames(&bench, 0);
    let observer = Observer::start(&bench.domain);
    let run = [python.to_str().unwrap(), script.to_str().unwrap()];
    let standby = ["standby", "deskewer", "--domain", bench.domain.name(), "--run"];
    bench.run(standby.iter().chain(&run)).expect_success();
    let pid = deskewer(&bench).unwrap()["pid"].as_i64().unwrap();
    kill_process(Pid::from_raw(i32::try_from(pid).unwrap()).unwrap(), Signal::KILL).unwrap();
    wait_for_frames(&bench, 1);
    let mut heard = observer.stop();
    // What the killed one put out last is put out once more, for whoever it did not reach.
    heard.scans.dedup_by_key(|frame| frame.seq);
    assert_gap_free("scan/deskewed", heard.scans.iter().map(|frame| frame.seq));
    assert_gap_free("odometry/pose", heard.poses.iter().map(|pose| pose.frame.seq));
    up.signal(Signal::TERM);
    up.end().expect_success();
}

#[test]
fn the_python_example_keeps_up_with_large_scans() {
    let Some(python) = python() else { return };
    let measure = Path::new(ROOT).join("examples/python/measure.py");
    // One a second: the pace is the measurement's affair, on a machine that has nothing else to do.
    let args = ["--seconds", "4", "--hz", "1", "--points", "24000"];
    let output = Command::new(python).arg(measure).args(args).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("4 came back, 0 lost, in order"), "{text}");
}

#[test]
fn the_services_of_the_python_example_are_those_of_this_build() {
    let bench = Bench::new();
    let printed = bench.run(["services"]).expect_success().stdout;
    let file = Path::new(ROOT).join("examples/python/evac_stage/services.json");
    assert!(
        std::fs::read_to_string(&file).unwrap() == printed,
        "a layout or service has changed: evac services > {}",
        file.display()
    );
}

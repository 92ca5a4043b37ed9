//! A simulated walk through all six stages, and what `evac status` says of it.
#![allow(dead_code)] // not every test needs all of it

use serde_json::Value;

use super::common::{Bench, wait_for};

pub(crate) const STAGES: [&str; 6] =
    ["simulator", "deskewer", "lio", "octree_mapper", "grid_exporter", "map_saver"];

/// A pipeline file of the simulator, with `head` at its top and results in `folder`.
pub(crate) fn pipeline(bench: &Bench, head: &str, folder: &str, simulator: &str) -> String {
    let mut text = format!("domain = \"{}\"\n{head}\n", bench.domain.name());
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

pub(crate) fn status(bench: &Bench) -> Option<Value> {
    let ended = bench.run(["status", "--domain", bench.domain.name(), "--json"]);
    serde_json::from_str(&ended.stdout).ok()
}

/// Waits until the leading instance of every stage has put out more than `frames`.
pub(crate) fn wait_for_frames(bench: &Bench, frames: u64) -> Value {
    wait_for("all stages to put out frames", || {
        let status = status(bench)?;
        let all = STAGES.iter().all(|stage| status["stages"][stage]["frames"]["out"].as_u64() > Some(frames));
        all.then_some(status)
    })
}

//! summary.json and the last lines on the terminal.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use evac_config::Pipeline;
use evac_evaluation::{associate, associate_absolute};
use evac_formats::{tum, write_atomically};
use serde_json::{Map, Value, json};

use crate::device_health::device_json;
use crate::drift::{Drift, drift};
use crate::error::LaunchError;
use crate::health_board::{HealthBoard, frames_json, latency_json, odometry_json, odometry_line};
use crate::registry::ODOMETRIES;

/// Files that a run leaves in its folder, in the order in which they are listed.
const OUTPUTS: &[&str] = &[
    "map.ot",
    "map.bt",
    "plan.pgm",
    "plan.yaml",
    "plan.png",
    "plan_ground.pfm",
    "plan_step.pfm",
    "plan_ground.png",
    "storeys.json",
    "trajectory.tum",
    "truth.tum",
    "cloud.pcd",
];

/// What was run.
#[derive(Debug)]
pub(crate) struct Run<'a> {
    pub(crate) command: &'static str,
    pub(crate) output: &'a Path,
    /// Truth given by the user; a simulated walk leaves its own in the folder.
    pub(crate) truth: Option<&'a Path>,
    pub(crate) about: String,
    /// The stage with whose last frame the run ends, where no sink can tell.
    pub(crate) ends_with: Option<&'static str>,
}

/// Writes summary.json and prints what matters of it. Lost frames are said, not hidden.
pub(crate) fn write(
    run: &Run<'_>,
    pipeline: &Pipeline,
    board: &HealthBoard,
    cpu: &BTreeMap<String, f64>,
    took: Duration,
) -> Result<(), LaunchError> {
    let trajectory = tum::read(&run.output.join("trajectory.tum"))?;
    let own_truth = run.output.join("truth.tum");
    // A truth.tum of an earlier run in the same folder says nothing about a recording.
    let truth = match run.truth {
        Some(path) => Some(tum::read(path)?),
        None if run.command == "demo" => Some(tum::read(&own_truth)?),
        None => None,
    };
    let drift = truth.and_then(|truth| {
        // The maps are there all the same.
        // Devices and truth are on the host's clock, and the first scans go by while the device's clock is being fitted.
        let pairs = if run.ends_with.is_some() { associate_absolute } else { associate };
        drift(&truth, &trajectory, pairs).unwrap_or_else(|cause| {
            tracing::warn!("no drift in the summary: {cause}");
            None
        })
    });
    let lost: u64 = board.all().map(|(_, health)| health.lost + health.late).sum();
    let stages: Map<String, Value> = board
        .all()
        .map(|(name, health)| {
            let cpu = cpu.get(name);
            let mut stage =
                json!({ "frames": frames_json(health), "latency": latency_json(health), "cpu_percent": cpu });
            if let device @ Value::Object(_) = device_json(health) {
                stage["device"] = device;
            }
            (name.to_owned(), stage)
        })
        .collect();
    let odometry = pipeline.stages.iter().find(|entry| ODOMETRIES.contains(&entry.kind.as_str()));
    let odometry = odometry.map_or("", |entry| entry.name());
    let end_to_end = board.get(odometry).map(|health| latency_json(health)["end_to_end"].clone());
    let summary = json!({
        "evac": env!("CARGO_PKG_VERSION"),
        "middleware": evac_ports::MIDDLEWARE,
        "command": run.command,
        "input": run.about,
        "frames": trajectory.len(),
        "frames_lost": lost,
        "wall_seconds": took.as_secs_f64(),
        "latency_to_pose": end_to_end,
        "odometry": board.get(odometry).map(odometry_json),
        "drift": drift,
        "stages": stages,
        "configuration": serde_json::to_value(pipeline).unwrap_or(Value::Null),
    });
    write_atomically(&run.output.join("summary.json"), |writer| writeln!(writer, "{summary:#}"))?;
    print(run, trajectory.len(), lost, drift.as_ref(), (board, odometry), took);
    Ok(())
}

fn print(
    run: &Run<'_>,
    frames: usize,
    lost: u64,
    drift: Option<&Drift>,
    (board, odometry): (&HealthBoard, &str),
    took: Duration,
) {
    let seconds = took.as_secs_f64();
    println!("{frames} frames in {seconds:.1} s ({:.0} per second), {lost} lost", frames as f64 / seconds);
    for line in crate::supervisor::losses(board) {
        println!("  {line}");
    }
    if let Some(drift) = drift {
        println!(
            "drift at the end {:.3} m of {:.1} m ({:.2} %) and {:.2} deg; absolute error {:.3} m rms, {:.3} m at most",
            drift.end_m,
            drift.path_m,
            drift.end_percent,
            drift.end_rotation_deg,
            drift.ape_rmse_m,
            drift.ape_max_m
        );
    }
    for (name, health) in board.all() {
        let ms = |ns: u64| ns as f64 * 1e-6;
        if health.degraded > 0 {
            println!("  {name}: {} frames degraded", health.degraded);
        }
        if name == odometry {
            if let Some(line) = odometry_line(health) {
                println!("{name} at the end: {line}");
            }
            let latency = health.end_to_end;
            println!(
                "last point to pose {:.1} ms (median), {:.1} ms (p99), {:.1} ms (most)",
                ms(latency.p50_ns),
                ms(latency.p99_ns),
                ms(latency.max_ns)
            );
        }
    }
    println!("in {}:", run.output.display());
    for name in OUTPUTS.iter().chain(&["summary.json", "pipeline.toml"]) {
        if let Ok(file) = std::fs::metadata(run.output.join(name)) {
            println!("  {name:<16} {:>10} bytes", file.len());
        }
    }
}

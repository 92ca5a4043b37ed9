//! `evac experiment table1`: the paper's section 4.1 on a simulated corridor loop, where the truth is known.

use std::path::Path;

use evac_config::ImuFromLidar;
use evac_evaluation::{Evaluation, Pairs};
use evac_experiments::{OdometryKind, Settings, Trajectory, Walk, run, simulated};
use evac_formats::tum::TumPose;
use evac_simulator::{Config, WorldKind};
use evac_stage::Rig;
use serde::Serialize;
use serde_json::json;

use super::cli::Table1Args;
use super::{usage, write_text};
use crate::error::LaunchError;
use crate::eval::plots::tracks;
use crate::finite::create_folder;

/// A method's column of the table.
#[derive(Debug, Serialize)]
struct Column {
    method: &'static str,
    #[serde(flatten)]
    evaluation: Evaluation,
    #[serde(skip)]
    pairs: Pairs,
}

pub(super) fn table1(args: &Table1Args) -> Result<(), LaunchError> {
    let walk = corridor(args)?;
    let mut columns = Vec::new();
    for (method, settings) in methods() {
        eprintln!("{method}: {} frames", walk.frames.len());
        columns.push(column(method, &run(&walk, &settings))?);
    }
    let table = table(&columns);
    println!("{table}");
    if let [without, with, _] = columns.as_slice() {
        let ratio = without.evaluation.end_m / with.evaluation.end_m;
        println!(
            "deskewing divides the displacement of loam's end point by {ratio:.1} (in the paper 18.3 m by 10.8)\n"
        );
    }
    write(args, &walk, &columns, &table)
}

/// The paper's two methods and evac's own.
fn methods() -> [(&'static str, Settings); 3] {
    let loam = Settings { odometry: OdometryKind::Loam, ..Settings::default() };
    let mut without = loam.clone();
    without.deskewer.enabled = false;
    [("loam without IMU", without), ("loam with deskewing", loam), ("lio", Settings::default())]
}

/// The basement corridor, once round.
fn corridor(args: &Table1Args) -> Result<Walk, LaunchError> {
    let config = Config {
        world: WorldKind::Corridor,
        seed: args.seed,
        duration_s: args.duration,
        ..Config::default()
    };
    let imu_from_lidar =
        ImuFromLidar { translation_m: [0.05, -0.02, 0.06], roll_pitch_yaw_deg: [0.5, -1.0, 1.5] };
    Ok(simulated("basement corridor", &config, &Rig { imu_from_lidar })?)
}

fn column(method: &'static str, trajectory: &Trajectory) -> Result<Column, LaunchError> {
    if let Some(cause) = &trajectory.refused {
        return Err(usage(format!("{method}: {cause}")));
    }
    let none = || {
        usage(format!("{method} gave no poses; walk longer than the standstill at its start (--duration)"))
    };
    let pairs = trajectory.pairs().ok_or_else(none)?;
    let evaluation = Evaluation::of(&pairs).ok_or_else(none)?;
    Ok(Column { method, evaluation, pairs })
}

/// The ten figures of the height, a row each as in the paper, then the end point and what the truth adds.
fn table(columns: &[Column]) -> String {
    let names: String = columns.iter().map(|column| format!(" {} |", column.method)).collect();
    let rule: String = columns.iter().map(|_| " ---: |").collect();
    let mut text = format!("| z above the start, m |{names}\n| --- |{rule}\n");
    let mut row = |name: &str, value: &dyn Fn(&Column) -> String| {
        let cells: String = columns.iter().map(|column| format!(" {} |", value(column))).collect();
        text += &format!("| {name} |{cells}\n");
    };
    let figures = columns.first().map_or_else(Vec::new, |first| first.evaluation.z_figures.rows().to_vec());
    for (index, (name, _)) in figures.iter().enumerate() {
        row(name, &|column| {
            let (_, value) = column.evaluation.z_figures.rows().get(index).copied().unwrap_or_default();
            if *name == "number" { format!("{value:.0}") } else { format!("{value:.5}") }
        });
    }
    row("displacement of the end point, m", &|column| format!("{:.3}", column.evaluation.end_m));
    row("the same in % of the path", &|column| format!("{:.3}", column.evaluation.end_percent));
    row("rotation at the end, deg", &|column| format!("{:.3}", column.evaluation.end_rotation_deg));
    row("APE (SE(3)), m", &|column| format!("{:.4}", column.evaluation.ape_se3.rmse));
    text
}

fn write(args: &Table1Args, walk: &Walk, columns: &[Column], table: &str) -> Result<(), LaunchError> {
    create_folder(&args.output)?;
    let file = |name: &str| args.output.join(name);
    let markdown = format!(
        "`evac experiment table1 --seed {}`: {:.1} m through the basement corridor, {} frames\n\n{table}",
        args.seed,
        walk.path_m(),
        walk.frames.len()
    );
    let whole = json!({
        "evac": env!("CARGO_PKG_VERSION"),
        "seed": args.seed,
        "path_m": walk.path_m(),
        "methods": columns,
    });
    write_text(&file("table1.md"), &markdown)?;
    write_text(&file("table1.json"), &format!("{whole:#}\n"))?;
    let truth: Vec<TumPose> = walk.frames.iter().map(true_pose).collect();
    let tracks = tracks(&truth, columns.iter().map(|column| (column.method, &column.pairs)));
    let [path, axes] = [file("path.png"), file("axes.png")];
    evac_picture::plot_paths(&path, "Path from above (Figure 8 of the paper)", &tracks)?;
    said(&path);
    evac_picture::plot_axes(&axes, "x, y and z (Figure 9 of the paper)", &tracks)?;
    said(&axes);
    Ok(())
}

fn said(path: &Path) {
    println!("{}", path.display());
}

fn true_pose(frame: &evac_experiments::Frame) -> TumPose {
    let q = frame.truth.rotation.quaternion();
    TumPose {
        stamp_ns: frame.header.frame.end_ns,
        position: frame.truth.translation.vector.into(),
        orientation: [q.i, q.j, q.k, q.w],
    }
}

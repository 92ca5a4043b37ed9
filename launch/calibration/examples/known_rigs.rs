//! How true calibrations are: simulated walks whose rig, clock and gyroscope are known to be off.
//!
//! `cargo run --release -p evac-calibration --example known_rigs [N] [WALK...]` prints one line a run, `error (standard error)` of
//! every number, and at the end the root mean squares of errors and of errors in units of their standard errors (honest: about
//! 1). N is added to all seeds and buildings: other walks of the same kinds.
#![allow(missing_docs, clippy::expect_used, reason = "a program for people who can read a panic")]

use std::collections::BTreeMap;

use evac_calibration::{Calibration, Correction, calibrate};
use evac_config::ImuFromLidar;
use evac_experiments::{Walk, in_threads, simulated};
use evac_geometry::nalgebra::Vector3;
use evac_geometry::{exp_so3, log_so3};
use evac_odometry::LioConfig;
use evac_simulator::{Config, Random, WorldKind};
use evac_stage::Rig;

/// Building, its number, seed, gait, auto-zero; rotation of the rig's file about a random axis (degrees), clock of the IMU
/// ahead (ms), scale (%).
type Run = (WorldKind, u64, u64, f64, bool, f64, f64, f64);

const RUNS: [Run; 16] = [
    (WorldKind::Corridor, 1, 1001, 1.0, true, 0.5, 5.0, 0.5),
    (WorldKind::Hall, 1, 1002, 1.0, false, 1.0, -20.0, -0.5),
    (WorldKind::FloorPlan, 21, 1003, 1.0, true, 3.0, 40.0, 0.5),
    (WorldKind::FloorPlan, 22, 1004, 0.5, false, 1.0, 80.0, -0.5),
    (WorldKind::FloorPlan, 23, 1005, 1.5, true, 0.5, -80.0, 0.0),
    (WorldKind::FloorPlan, 24, 1006, 0.8, false, 3.0, -40.0, 0.5),
    (WorldKind::Office, 3, 1007, 1.0, true, 1.0, 0.0, 0.5),
    (WorldKind::Office, 4, 1008, 1.2, false, 0.5, 60.0, -0.5),
    (WorldKind::Rough, 31, 1009, 1.0, true, 3.0, -60.0, -0.5),
    (WorldKind::Rough, 32, 1010, 0.7, false, 0.0, 0.0, 0.0),
    (WorldKind::Tunnel, 3, 1011, 1.0, true, 1.0, 20.0, 0.5),
    (WorldKind::Atrium, 3, 1012, 1.0, false, 0.5, -5.0, -0.5),
    (WorldKind::OpenHall, 3, 1013, 1.0, true, 3.0, 80.0, 0.5),
    (WorldKind::Ramp, 3, 1014, 1.0, false, 1.0, -80.0, 0.5),
    (WorldKind::FloorPlan, 25, 1015, 0.0, true, 1.0, 20.0, 0.5),
    (WorldKind::FloorPlan, 26, 1016, 2.0, false, 3.0, 10.0, -0.5),
];
const SECONDS: f64 = 60.0;

fn main() {
    let (numbers, only): (Vec<_>, Vec<_>) =
        std::env::args().skip(1).partition(|word| word.parse::<u64>().is_ok());
    let shift: u64 = numbers.iter().filter_map(|number| number.parse::<u64>().ok()).sum();
    let name = |run: &Run| format!("{:?}_{}", run.0, run.1).to_lowercase();
    let runs: Vec<Run> = RUNS
        .into_iter()
        .map(|(world, building, seed, a, b, c, d, e)| (world, building + shift, seed + shift, a, b, c, d, e))
        .filter(|run| only.is_empty() || only.iter().any(|part| name(run).contains(part.as_str())))
        .collect();
    let mut scores = Scores::default();
    println!(
        "{:<14} {:>4} {:>5} {:>5}  passes, scans used / in all, stretches; error (standard error)",
        "walk", "deg", "ms", "%"
    );
    in_threads(
        runs.len(),
        2,
        |index| calibrated(&runs[index]),
        |index, found| {
            let run = &runs[index];
            print!("{:<14} {:>4} {:>5} {:>5}  ", name(run), run.5, run.6, run.7);
            match found {
                Ok((found, truth)) => scores.take(&found, &truth),
                Err(cause) => println!("{cause}"),
            }
        },
    );
    scores.print();
}

fn calibrated(run: &Run) -> Result<(Calibration, Correction), String> {
    let (world, building, seed, gait, auto_zero, degrees, ahead_ms, percent) = *run;
    let rig = Rig {
        imu_from_lidar: ImuFromLidar {
            translation_m: [0.05, -0.02, 0.06],
            roll_pitch_yaw_deg: [0.5, -1.0, 1.5],
        },
    };
    let config =
        Config { world, building, seed, gait, auto_zero, duration_s: Some(SECONDS), ..Config::default() };
    let walk = simulated("walk", &config, &rig).map_err(|cause| cause.to_string())?;
    let axis = Vector3::from(Random::new(seed, 0xca).normals()).normalize();
    let (wrong, truth) = wrong(&walk, &(axis * degrees.to_radians()), ahead_ms, percent * 1e-2);
    let found = calibrate(&wrong, &LioConfig::default(), |_| ()).map_err(|cause| cause.to_string())?;
    Ok((found, truth))
}

/// The walk as a rig that is off gives it, and the correction that is to be found.
fn wrong(walk: &Walk, misalignment: &Vector3<f64>, ahead_ms: f64, scale: f64) -> (Walk, Correction) {
    let mut imu = walk.imu();
    for sample in &mut imu {
        sample.stamp_ns += (ahead_ms * 1e6) as i64;
        sample.gyro = sample.gyro.map(|rate| rate * (1.0 + scale));
    }
    let rotation = exp_so3(misalignment) * walk.rig.imu_from_lidar().rotation;
    let (roll, pitch, yaw) = rotation.euler_angles();
    let given = ImuFromLidar {
        roll_pitch_yaw_deg: [roll, pitch, yaw].map(f64::to_degrees),
        ..walk.rig.imu_from_lidar
    };
    let truth = Correction {
        misalignment: *misalignment,
        gyro_scale: Vector3::repeat(scale),
        time_offset_s: -ahead_ms * 1e-3,
        ..Correction::default()
    };
    (Walk { rig: Rig { imu_from_lidar: given }, ..walk.with_imu(&imu) }, truth)
}

/// Errors with their standard errors by name; those of numbers with a warning apart.
#[derive(Default)]
struct Scores(BTreeMap<String, Vec<(f64, f64)>>);

impl Scores {
    fn take(&mut self, found: &Calibration, truth: &Correction) {
        let unsettled = if found.settled { "" } else { "!" };
        print!("{}{unsettled} {}/{} {} ", found.passes, found.scans, found.scans_in_all, found.stretches);
        for estimate in &found.estimates {
            let error = match (estimate.axis, estimate.unit()) {
                (Some(axis), "deg") => estimate.value - truth.misalignment[axis].to_degrees(),
                (Some(axis), _) => estimate.value - truth.gyro_scale[axis] * 100.0,
                _ => estimate.value - truth.time_offset_s * 1e3,
            };
            let warned = if estimate.warning.is_some() { "*" } else { "" };
            print!(" {} {error:+.3} ({:.3}){warned}", estimate.name(), estimate.standard_error);
            self.0
                .entry(format!("{}{warned}", estimate.name()))
                .or_default()
                .push((error, estimate.standard_error));
        }
        let left = exp_so3(&-truth.misalignment) * exp_so3(&found.correction.misalignment);
        println!("  rig off by {:.3} deg", log_so3(&left).norm().to_degrees());
    }

    fn print(&self) {
        for (name, scores) in &self.0 {
            let n = scores.len() as f64;
            let rms = |of: &dyn Fn(&(f64, f64)) -> f64| {
                (scores.iter().map(|one| of(one).powi(2)).sum::<f64>() / n).sqrt()
            };
            let worst = scores.iter().map(|(error, _)| error.abs()).fold(0.0, f64::max);
            let within = scores.iter().filter(|(error, sigma)| error.abs() < 2.0 * sigma).count();
            println!(
                "{name:<14} {n} runs: error rms {:.4} worst {worst:.4}, standard error rms {:.4}, z rms {:.2}, \
                 within two {:.0} %",
                rms(&|one| one.0),
                rms(&|one| one.1),
                rms(&|one| one.0 / one.1),
                within as f64 / n * 100.0
            );
        }
        println!("* too little motion: warned of");
    }
}

//! The paper's comparison: the corridor loop with `loam` on deskewed scans and without the deskewer.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic as the test may")]

mod common;

use common::{Figures, Pipeline, print};
use evac_deskewer::DeskewerConfig;
use evac_geometry::map_from_lidar;
use evac_odometry::{Loam, LoamConfig};
use evac_simulator::{Config, simulate};
use evac_stage::Rig;

/// The paper lost 18.3 m without and 1.7 m with, a ratio of 10.
const RATIO: f64 = 5.0;

#[test]
fn deskewing_divides_the_end_drift_of_the_corridor_loop_by_more_than_five() {
    for seed in [11, 12, 13] {
        let (with, without) = (walk(seed, true), walk(seed, false));
        println!(
            "seed {seed}: end drift {:.3} m with, {:.3} m without, ratio {:.1}",
            with.drift,
            without.drift,
            without.drift / with.drift
        );
        assert!(without.drift > RATIO * with.drift, "{with:?} {without:?}");
        assert!(with.drift < 1.7 && with.lost == 0, "{with:?}");
    }
}

fn walk(seed: u64, enabled: bool) -> Figures {
    let rig = Rig::default();
    let deskewer = DeskewerConfig { enabled, ..DeskewerConfig::default() };
    let mut pipeline = Pipeline::<Loam>::with_deskewer(deskewer, LoamConfig::default(), &rig);
    let mut truth = Vec::new();
    for frame in simulate(&Config { seed, ..Config::default() }, &rig).unwrap() {
        pipeline.feed(&frame.header, &frame.points, &frame.imu);
        truth.push(map_from_lidar(&frame.truth));
    }
    let figures = Figures::of(pipeline.trajectory(), &truth);
    print(if enabled { "with" } else { "without" }, &pipeline, &figures);
    figures
}

//! The simulator's own buildings with everything that its sensors do wrong, above all the gyroscope's auto-zero.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic as the test may")]

mod common;

use common::{Figures, Pipeline, print};
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::Isometry3;
use evac_simulator::{Config, WorldKind, simulate};
use evac_stage::Rig;

#[test]
fn the_corridor_loop_ends_within_two_percent_of_its_start() {
    assert_world("corridor", Config { world: WorldKind::Corridor, seed: 11, ..Config::default() });
}

#[test]
fn the_hall_with_walking_people_is_held_within_two_percent() {
    assert_world("hall", Config { world: WorldKind::Hall, seed: 12, ..Config::default() });
}

#[test]
fn the_stairwell_is_climbed_within_two_percent() {
    assert_world("stairwell", Config { world: WorldKind::Stairwell, seed: 13, ..Config::default() });
}

#[test]
fn five_milliseconds_between_the_clocks_do_not_lose_the_corridor() {
    let config = Config { imu_clock_offset_ms: 5.0, seed: 14, ..Config::default() };
    assert_world("corridor with a clock offset of 5 ms", config);
}

#[test]
fn who_goes_round_a_corridor_six_times_is_at_the_end_where_the_map_of_the_first_time_says() {
    let config = Config { world: WorldKind::Corridor, seed: 15, laps: 6, ..Config::default() };
    let (pipeline, truth) = walk(&config);
    let figures = Figures::of(pipeline.trajectory(), &truth);
    print("six laps", &pipeline, &figures);
    assert!(figures.ape < 0.06, "APE {:.3} m", figures.ape);
    assert!(figures.drift < 0.06, "{:.3} m at the end", figures.drift);
    assert_eq!(figures.lost, 0);
}

fn assert_world(name: &str, config: Config) {
    let (pipeline, truth) = walk(&config);
    let figures = Figures::of(pipeline.trajectory(), &truth);
    print(name, &pipeline, &figures);
    assert!(figures.drift_percent() < 2.0, "drift {:.3} %", figures.drift_percent());
    assert!(figures.ape < 0.3, "APE {:.3} m", figures.ape);
    assert_eq!(figures.lost, 0);
}

/// What is published on a walk, and where the LiDAR was.
fn walk(config: &Config) -> (Pipeline, Vec<Isometry3<f64>>) {
    let rig = Rig::default();
    let mut pipeline = Pipeline::new(&rig);
    let mut truth = Vec::new();
    for frame in simulate(config, &rig).unwrap() {
        pipeline.feed(&frame.header, &frame.points, &frame.imu);
        truth.push(map_from_lidar(&frame.truth));
    }
    (pipeline, truth)
}

//! Runs over short simulated walks.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test's helpers may panic as the test may")]

use std::sync::Mutex;

use evac_experiments::report::{Run, accuracy, honesty, robustness};
use evac_experiments::{
    Fault, Figures, Group, OdometryKind, Settings, Trajectory, Verdict, Walk, in_threads, run, simulated,
};
use evac_frames::{PoseFrame, TrackingState};
use evac_geometry::nalgebra::Translation3;
use evac_simulator::Config;
use evac_stage::Rig;

fn short(seed: u64) -> Walk {
    let config = Config { seed, duration_s: Some(6.0), ..Config::default() };
    simulated("corridor", &config, &Rig::default()).unwrap()
}

fn poses(trajectory: &Trajectory) -> Vec<PoseFrame> {
    trajectory.frames.iter().map(|frame| frame.pose).collect()
}

#[test]
fn two_runs_over_the_same_walk_are_equal_to_the_byte_in_one_thread_and_in_two() {
    let walk = short(31);
    let once = poses(&run(&walk, &Settings::default()));
    for threads in [1, 2] {
        let in_order = Mutex::new(Vec::new());
        in_threads(
            3,
            threads,
            |_| poses(&run(&walk, &Settings::default())),
            |index, poses| in_order.lock().unwrap().push((index, poses)),
        );
        for (expected, (index, again)) in in_order.into_inner().unwrap().into_iter().enumerate() {
            assert_eq!(expected, index);
            assert_eq!(once, again, "{threads} threads");
        }
    }
}

#[test]
fn the_start_of_a_walk_is_held_and_its_figures_are_those_of_the_truth() {
    let walk = short(32);
    let trajectory = run(&walk, &Settings::default());
    let figures = Figures::of(&trajectory);
    assert!(figures.frames > 40 && figures.start_s < 2.0, "{figures:?}");
    assert!((figures.path_m - walk.path_m()).abs() < 0.05, "{figures:?}");
    assert!(figures.ape_m < 0.05 && figures.jump_m < 0.05, "{figures:?}");
    assert_eq!(Verdict::of(&trajectory, &figures), Verdict::Held);
}

#[test]
fn a_trajectory_that_is_the_truth_has_no_error_and_one_with_a_step_in_it_fails_by_the_step() {
    let walk = short(33);
    let mut trajectory = run(&walk, &Settings::default());
    for frame in &mut trajectory.frames {
        frame.pose.state = TrackingState::Tracking as u32;
        evac_geometry::set_map_from_lidar(&mut frame.pose, &frame.truth);
    }
    let figures = Figures::of(&trajectory);
    assert!(figures.ape_max_m < 1e-9 && figures.drift_m < 1e-9 && figures.jump_m < 1e-9, "{figures:?}");
    assert_eq!(Verdict::of(&trajectory, &figures), Verdict::Held);
    // The walker stands: a step of 0.4 m is published, and stays.
    for frame in trajectory.frames.iter_mut().skip(20) {
        let stepped = Translation3::new(0.0, 0.4, 0.0) * frame.truth;
        evac_geometry::set_map_from_lidar(&mut frame.pose, &stepped);
    }
    let figures = Figures::of(&trajectory);
    assert!((figures.jump_m - 0.4).abs() < 1e-6, "{figures:?}");
    assert_eq!(Verdict::of(&trajectory, &figures), Verdict::Failed);
}

#[test]
fn who_says_lost_before_the_error_and_recovers_has_recovered_and_who_says_it_later_has_failed() {
    let walk = short(34);
    let truth = run(&walk, &Settings::default());
    // From frame 30 on the error grows by 0.25 m a frame for 6 frames, then it stays.
    let with = |lost: std::ops::Range<usize>| {
        let mut trajectory = truth.clone();
        for (index, frame) in trajectory.frames.iter_mut().enumerate() {
            let away = 0.25 * (index.saturating_sub(29).min(6)) as f64;
            let state = if lost.contains(&index) { TrackingState::Lost } else { TrackingState::Tracking };
            frame.pose.state = state as u32;
            let moved = Translation3::new(0.0, away, 0.0) * frame.truth;
            evac_geometry::set_map_from_lidar(&mut frame.pose, &moved);
        }
        let figures = Figures::of(&trajectory);
        Verdict::of(&trajectory, &figures)
    };
    assert_eq!(with(29..36), Verdict::Recovered);
    assert_eq!(with(36..40), Verdict::Failed);
    assert_eq!(with(0..0), Verdict::Failed);
}

#[test]
fn a_wrong_rig_makes_a_worse_run_than_the_right_one() {
    let walk = simulated(
        "corridor",
        &Config { seed: 35, duration_s: Some(12.0), ..Config::default() },
        &Rig::default(),
    )
    .unwrap();
    let ape = |fault: Fault| Figures::of(&run(&fault.applied(&walk, 1), &Settings::default())).ape_m;
    // How much worse is for the tables: the filter finds part of the error out.
    assert!(ape(Fault::Rotation(10)) > ape(Fault::None));
}

#[test]
fn a_tunnel_where_each_view_is_laid_from_the_one_before_takes_the_odometry_away_no_farther_than_it_says() {
    let tunnel =
        evac_simulator::catalogue(5).into_iter().find(|walk| walk.name.starts_with("tunnel_2")).unwrap();
    let config = Config { duration_s: Some(40.0), ..tunnel.config };
    let walk = simulated(&tunnel.name, &config, &tunnel.rig).unwrap();
    let trajectory = run(&walk, &Settings::default());
    let figures = Figures::of(&trajectory);
    assert!(figures.within_3_sigma > 0.99, "{figures:?}");
    // Nor does it say whatever it likes.
    let variance = trajectory.frames.last().map(|last| last.pose.covariance[0].max(last.pose.covariance[7]));
    assert!(variance.unwrap().sqrt() < 0.1, "{variance:?}");
}

#[test]
fn the_papers_odometry_runs_too_and_is_worse_off_without_the_deskewer() {
    let config = Config { seed: 38, duration_s: Some(25.0), ..Config::default() };
    let walk = simulated("corridor", &config, &Rig::default()).unwrap();
    let with = Settings { odometry: OdometryKind::Loam, ..Settings::default() };
    let mut without = with.clone();
    without.deskewer.enabled = false;
    let drift = |settings: &Settings| Figures::of(&run(&walk, settings)).drift_m;
    assert!(drift(&without) > 2.0 * drift(&with), "{} {}", drift(&without), drift(&with));
}

#[test]
fn a_stage_that_refuses_its_configuration_is_a_result_with_its_reason() {
    let mut settings = Settings::default();
    settings.lio.range_noise_m = -1.0;
    let trajectory = run(&short(36), &settings);
    assert!(trajectory.refused.as_ref().unwrap().contains("range_noise_m"));
    assert_eq!(Verdict::of(&trajectory, &Figures::of(&trajectory)), Verdict::Refused);
}

#[test]
fn reports_hold_every_run_and_say_which_limit_is_missed() {
    let walk = short(37);
    let runs: Vec<_> = [Fault::None, Fault::GyroScale]
        .map(|fault| {
            let trajectory = run(&fault.applied(&walk, 1), &Settings::default());
            Run::new(&walk.name, Group::Boxes, fault, &trajectory)
        })
        .to_vec();
    let report = accuracy(&runs);
    assert!(report.table.contains("| corridor |") && report.table.contains("gyro-scale-0.5%"));
    assert_eq!(report.acceptance.len(), 2);
    assert!(report.acceptance.iter().all(|limit| limit.holds), "{:?}", report.acceptance);
    let report = robustness(&runs);
    assert_eq!((report.runs.len(), report.acceptance.len()), (2, 2));
    assert!(honesty(&runs[..1]).table.contains("| corridor |"));
    // A run without a pose holds nothing.
    let nothing = Run::new("nothing", Group::Recorded, Fault::None, &Trajectory::default());
    assert!(accuracy(&[nothing]).acceptance.iter().all(|limit| !limit.holds));
}

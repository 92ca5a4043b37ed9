//! Walks whose rig and clock are known to be off.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    missing_docs,
    reason = "a test's helpers may panic as the test may"
)]

use evac_calibration::{Calibration, CalibrationError, Quantity, calibrate};
use evac_config::ImuFromLidar;
use evac_experiments::{Walk, in_threads, simulated};
use evac_geometry::exp_so3;
use evac_geometry::nalgebra::Vector3;
use evac_odometry::LioConfig;
use evac_simulator::{Config, WorldKind};
use evac_stage::Rig;

const TRUE_RIG: ImuFromLidar =
    ImuFromLidar { translation_m: [0.05, -0.02, 0.06], roll_pitch_yaw_deg: [0.5, -1.0, 1.5] };

/// A walk whose rig's file is off by a rotation vector in degrees, and whose IMU's stamps are ahead by milliseconds.
fn wrong(config: &Config, degrees: [f64; 3], ahead_ms: i64) -> Walk {
    let rig = Rig { imu_from_lidar: TRUE_RIG };
    let walk = simulated("walk", config, &rig).unwrap();
    let mut imu = walk.imu();
    imu.iter_mut().for_each(|sample| sample.stamp_ns += ahead_ms * 1_000_000);
    let off = exp_so3(&Vector3::from(degrees.map(f64::to_radians)));
    let (roll, pitch, yaw) = (off * rig.imu_from_lidar().rotation).euler_angles();
    let roll_pitch_yaw_deg = [roll, pitch, yaw].map(f64::to_degrees);
    Walk {
        rig: Rig { imu_from_lidar: ImuFromLidar { roll_pitch_yaw_deg, ..TRUE_RIG } },
        ..walk.with_imu(&imu)
    }
}

fn rotation_left_deg(found: &Calibration) -> f64 {
    let true_rig = Rig { imu_from_lidar: TRUE_RIG };
    found.rig.imu_from_lidar().rotation.angle_to(&true_rig.imu_from_lidar().rotation).to_degrees()
}

fn warned(found: &Calibration) -> Vec<(Quantity, Option<usize>)> {
    found.warnings().map(|(one, _)| (one.quantity, one.axis)).collect()
}

#[test]
fn walks_of_a_minute_give_rotation_and_clock_as_promised_and_errors_as_said() {
    // Building, its number, seed; what the rig's file is off by in degrees, and the clock in milliseconds.
    let runs = [
        (WorldKind::OpenHall, 3, 401, [2.0, -1.5, 1.7], 80),
        (WorldKind::Hall, 1, 404, [-1.0, 0.5, -0.8], -20),
    ];
    in_threads(
        runs.len(),
        2,
        |index| {
            let (world, building, seed, degrees, ahead_ms) = runs[index];
            let config = Config { world, building, seed, duration_s: Some(60.0), ..Config::default() };
            let walk = wrong(&config, degrees, ahead_ms);
            let mut passes = Vec::new();
            let found =
                calibrate(&walk, &LioConfig::default(), |progress| passes.push(progress.pass)).unwrap();
            assert_eq!(passes.len(), walk.frames.len() * found.passes as usize);
            found
        },
        |index, found| assert_promise(&found, runs[index].3, runs[index].4),
    );
}

/// Within 0.5 degrees and 2 ms, and within three standard errors, which are narrow enough to say something.
#[track_caller]
fn assert_promise(found: &Calibration, degrees: [f64; 3], ahead_ms: i64) {
    assert!(rotation_left_deg(found) < 0.5, "{found:#?}");
    assert!((found.correction.time_offset_s * 1e3 + ahead_ms as f64).abs() < 2.0, "{found:#?}");
    // What is not turned stays: the lever arm.
    assert_eq!(found.rig.imu_from_lidar.translation_m, TRUE_RIG.translation_m);
    for one in &found.estimates {
        let (truth, widest) = match (one.quantity, one.axis) {
            (Quantity::Time, _) => (-ahead_ms as f64, 1.0),
            (Quantity::Rotation, Some(axis)) => (degrees[axis], 0.25),
            _ => continue,
        };
        let error = one.value - truth;
        println!("{}: off by {error:+.3} ({:.3})", one.name(), one.standard_error);
        assert!(error.abs() < 3.0 * one.standard_error, "{}: {error} in {found:#?}", one.name());
        assert!(one.standard_error < widest || one.warning.is_some(), "{found:#?}");
    }
    let time_is_warned = warned(found).iter().any(|(quantity, _)| *quantity == Quantity::Time);
    assert!(!time_is_warned, "{found:#?}");
}

#[test]
fn a_trolley_that_never_tilts_is_warned_about_the_rotation_around_the_vertical_and_keeps_what_was_given() {
    let config = Config {
        world: WorldKind::Hall,
        seed: 402,
        gait: 0.0,
        // So smoothly does it roll that the firmware would take it for rest.
        auto_zero: false,
        mount_tilt_deg: [0.0; 2],
        duration_s: Some(40.0),
        ..Config::default()
    };
    let found = calibrate(&wrong(&config, [0.0, 0.0, 1.0], 0), &LioConfig::default(), |_| ()).unwrap();
    assert!(warned(&found).contains(&(Quantity::Rotation, Some(2))), "{found:?}");
    let (_, words) = found.warnings().find(|(one, _)| one.name() == "rotation z").unwrap();
    assert!(words.contains("tilt it about x or y"), "{words}");
    assert!(!warned(&found).contains(&(Quantity::Scale, Some(2))), "turns show the scale about z: {found:?}");
    let left = rotation_left_deg(&found);
    assert!((0.8..1.2).contains(&left), "the degree about z was not to be seen: {left}");
}

#[test]
fn a_walk_without_a_stretch_of_scans_is_refused_with_what_to_do() {
    let config = Config { seed: 403, duration_s: Some(4.0), ..Config::default() };
    let error = calibrate(&wrong(&config, [0.0; 3], 0), &LioConfig::default(), |_| ()).unwrap_err();
    assert!(matches!(error, CalibrationError::TooLittle { .. }), "{error}");
    assert!(error.to_string().contains("walk for a minute"), "{error}");
}

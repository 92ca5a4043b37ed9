//! What the pose does where one odometry hands over to the other, in a walk around corners.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test's helpers may panic as the test may")]

use std::collections::BTreeMap;

use evac_experiments::{Moment, OdometryKind, Settings, hand_overs, simulated};
use evac_geometry::map_from_lidar;
use evac_simulator::Config;
use evac_stage::Rig;

/// Farthest that the step over a cut may be off the true one, metres and degrees.
const MAX_STEP: (f64, f64) = (0.02, 0.2);

#[test]
fn lio_and_loam_hand_over_to_each_other_without_a_step_in_the_pose_stream() {
    let config = Config { seed: 1, duration_s: Some(50.0), ..Config::default() };
    let walk = simulated("corridor", &config, &Rig::default()).unwrap();
    let (cuts, poses) = hand_overs(&walk, &Settings::default(), |moment| moment.ready[0]).unwrap();
    assert_eq!(poses.len(), walk.frames.len());
    // Both ways, and often enough that a corner is among them.
    assert!(cuts.len() >= 4, "{cuts:?}");
    for cut in &cuts {
        let (way, turn) = cut.step;
        println!(
            "frame {:4}, {:?} after {:3} frames: step {:4.1} mm and {:.3} degrees off, beside the old one {:4.1} mm and {:.3}",
            cut.frame,
            cut.to,
            cut.ready_after,
            way * 1e3,
            turn.to_degrees(),
            cut.beside.0 * 1e3,
            cut.beside.1.to_degrees()
        );
        assert!(way < MAX_STEP.0 && turn.to_degrees() < MAX_STEP.1, "{cut:?}");
    }
}

/// Farthest off where the IMU is silent in that frame too, metres and degrees: a walker's change of speed within 0.1 s, and what a scan that
/// nothing has deskewed says of the rotation. (The old one would have been 1 degree off.)
const MAX_BLIND_STEP: (f64, f64) = (0.05, 4.0);

#[test]
fn a_standby_of_one_that_was_killed_right_after_its_largest_step_makes_none_of_its_own() {
    let config = Config { seed: 1, duration_s: Some(36.0), laps: 3, ..Config::default() };
    let walk = simulated("corridor", &config, &Rig::default()).unwrap();
    let settings = Settings { odometry: OdometryKind::Loam, ..Settings::default() };
    let mut ready = BTreeMap::new();
    let watch = |moment: &Moment| {
        ready.insert(moment.frame, moment.ready);
        false
    };
    let (_, poses) = hand_overs(&walk, &settings, watch).unwrap();
    let off = |frame: usize| {
        let (before, at) = (&walk.frames[frame - 1].truth, &walk.frames[frame].truth);
        let step = map_from_lidar(&poses[frame - 1]).inverse() * map_from_lidar(&poses[frame]);
        ((before.inverse() * at).inverse() * step).translation.vector.norm()
    };
    // The launcher knew it as ready before that step.
    let candidates = ready.iter().filter(|(frame, ready)| ready[1] && **frame < poses.len());
    let frame =
        *candidates.map(|(frame, _)| frame).max_by(|a, b| off(**a - 1).total_cmp(&off(**b - 1))).unwrap();
    let mut silent = walk.clone();
    silent.frames[frame].imu.clear();
    for (walk, limit) in [(&walk, MAX_STEP), (&silent, MAX_BLIND_STEP)] {
        let (cuts, _) = hand_overs(walk, &settings, |moment| moment.frame == frame).unwrap();
        let cut = cuts.first().unwrap();
        println!(
            "after a step {:.1} mm off: frame {}, {:?}: {:.1} mm and {:.3} degrees off",
            off(frame - 1) * 1e3,
            cut.frame,
            cut.to,
            cut.step.0 * 1e3,
            cut.step.1.to_degrees()
        );
        assert!(cut.step.0 < limit.0 && cut.step.1.to_degrees() < limit.1, "{cut:?}");
    }
}

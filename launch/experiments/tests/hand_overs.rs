//! What the pose does where one odometry hands over to the other, in a walk around corners.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test's helpers may panic as the test may")]

use evac_experiments::{Settings, hand_overs, simulated};
use evac_simulator::Config;
use evac_stage::Rig;

/// Farthest that the step over a cut may be off the true one, metres and degrees.
const MAX_STEP: (f64, f64) = (0.02, 0.2);

#[test]
fn lio_and_loam_hand_over_to_each_other_without_a_step_in_the_pose_stream() {
    let config = Config { seed: 1, duration_s: Some(50.0), ..Config::default() };
    let walk = simulated("corridor", &config, &Rig::default()).unwrap();
    let (cuts, poses) = hand_overs(&walk, &Settings::default(), 0).unwrap();
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

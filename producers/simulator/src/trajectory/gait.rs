//! How a walking body moves the rig that it carries.

use std::f64::consts::TAU;

use super::jet::Jet;
use crate::random::Random;

/// Steps per second; a stride (left and right) takes two.
const STEP_HZ: f64 = 1.8;
/// Turning on the spot shakes the rig less than walking.
const TURNING_SHARE: f64 = 0.35;

/// One oscillation of the body: amplitude in metres or radians, frequency in Hz.
#[derive(Debug, Clone, Copy)]
struct Oscillation {
    amplitude: f64,
    hz: f64,
    phase: f64,
}

impl Oscillation {
    fn at(&self, t: f64) -> Jet {
        Jet { x: TAU * self.hz * t + self.phase, v: TAU * self.hz, a: 0.0 }.sin() * self.amplitude
    }
}

/// Offsets from a smooth ride.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sway {
    pub(super) left: Jet,
    pub(super) up: Jet,
    pub(super) roll: Jet,
    pub(super) pitch: Jet,
    pub(super) yaw: Jet,
}

/// Bob and sway with the steps, and a slow wander because nobody walks along a ruler.
#[derive(Debug, Clone)]
pub(crate) struct Gait {
    left: [Oscillation; 2],
    up: [Oscillation; 2],
    roll: [Oscillation; 2],
    pitch: [Oscillation; 2],
    yaw: [Oscillation; 2],
}

impl Gait {
    /// Amplitudes times `scale`, phases from the seed.
    pub(crate) fn new(scale: f64, random: &mut Random) -> Self {
        let mut oscillation = |amplitude: f64, hz: f64| Oscillation {
            amplitude: amplitude * scale,
            hz,
            phase: TAU * random.uniform(),
        };
        let stride = STEP_HZ / 2.0;
        let degrees = f64::to_radians;
        Self {
            left: [oscillation(0.015, stride), oscillation(0.03, 0.13)],
            up: [oscillation(0.02, STEP_HZ), oscillation(0.004, 2.0 * STEP_HZ)],
            roll: [oscillation(degrees(1.2), stride), oscillation(degrees(0.5), 0.21)],
            pitch: [oscillation(degrees(0.8), STEP_HZ), oscillation(degrees(0.7), 0.17)],
            yaw: [oscillation(degrees(1.2), stride), oscillation(degrees(1.5), 0.11)],
        }
    }

    /// The sway at `t` seconds, given the share of walking and of turning speed (zero: exactly still).
    pub(super) fn at(&self, t: f64, walking: Jet, turning: Jet) -> Sway {
        let share = walking + turning * TURNING_SHARE;
        let sum = |[fast, slow]: &[Oscillation; 2]| share * (fast.at(t) + slow.at(t));
        Sway {
            left: sum(&self.left),
            up: sum(&self.up),
            roll: sum(&self.roll),
            pitch: sum(&self.pitch),
            yaw: sum(&self.yaw),
        }
    }
}

//! Scan-to-scan tracking until the velocity is known well enough to lay a map: after a start in motion and after a loss
//! from which there was no way back.

use super::filter::Filter;
use super::state::{add_variance, at};

/// Frames of it.
const FRAMES: u32 = 15;
/// The map of these frames is smeared by a velocity that their deskewing did not know; it is used for so many only.
const REFRESH: u32 = 5;
/// Times that it goes on for so many frames more while the velocity is not known to [`KNOWN_VELOCITY`]. At a start that is 50 s: who walks along
/// a blank wall for so long is carried by the IMU alone, whatever is begun, and before that a corner or a stop comes. After a loss it is 10 s.
const MORE_AT_START: u32 = 100;
const MORE_AFTER_LOSS: u32 = 20;
/// Standard deviation, m/s.
const KNOWN_VELOCITY: f64 = 0.2;
/// Errors of velocity and rotation (m/s, rad) between two scans that are smeared differently.
const SMEARED_VELOCITY: f64 = 0.5;
const SMEARED_ROTATION: f64 = 0.01;

/// How far the settling is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Settling {
    frames_left: u32,
    /// Times that it may go on while the velocity is not known.
    frames_more: u32,
    /// The map frame is not yet fixed: it will be where the LiDAR is at the end.
    pub(crate) starting: bool,
}

/// What to do with the map that is only used meanwhile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scratch {
    /// Add the scan.
    Extend,
    /// Clear it and add the scan.
    Renew,
    /// Clear it and add nothing: the map begins with the next frame, the first that is deskewed with a known velocity.
    Done,
}

impl Settling {
    pub(crate) fn at_start() -> Self {
        Self { frames_left: FRAMES, frames_more: MORE_AT_START, starting: true }
    }

    pub(crate) fn after_loss() -> Self {
        Self { frames_left: FRAMES, frames_more: MORE_AFTER_LOSS, starting: false }
    }

    /// Counts a frame.
    pub(crate) fn step(self, filter: &mut Filter) -> Scratch {
        let is_known = filter.degeneracy.count == 0 && filter.velocity_sigma() < KNOWN_VELOCITY;
        if self.frames_left <= 1 && (is_known || self.frames_more == 0) {
            filter.settling = None;
            return Scratch::Done;
        }
        if self.frames_left <= 1 {
            // Before a blank wall the velocity along it is not seen: a map laid now would be laid in the dark.
            filter.settling = Some(Self { frames_left: REFRESH, frames_more: self.frames_more - 1, ..self });
            return Scratch::Renew;
        }
        // A displacement between smeared scans is no measure of acceleration or rate: gravity and biases must not
        // follow it.
        if self.frames_left > REFRESH {
            add_variance(&mut filter.covariance, at::VELOCITY, SMEARED_VELOCITY.powi(2));
            add_variance(&mut filter.covariance, at::ROTATION, SMEARED_ROTATION.powi(2));
        }
        filter.settling = Some(Self { frames_left: self.frames_left - 1, ..self });
        if self.frames_left.is_multiple_of(REFRESH) { Scratch::Renew } else { Scratch::Extend }
    }
}

//! When the odometry said that it was lost, and what it was worth before and after.

use evac_evaluation::Pairs;
use evac_frames::TrackingState;
use evac_geometry::map_from_lidar;
use serde::Serialize;

use crate::FrameResult;

/// "Lost" must be said before the error passes this, metres.
const ERROR_LIMIT_M: f64 = 0.5;
/// A pause of "lost" shorter than this is no recovery, seconds.
const PAUSE_S: f64 = 5.0;

/// The losses of one run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Losses {
    /// Frames in which "lost" was said.
    pub frames: usize,
    /// Times that it was lost; pauses below 5 s do not part two losses.
    pub times: usize,
    /// Longest time from the first "lost" to the last of one loss, seconds.
    pub recovery_s: f64,
    /// Whether the error stayed below half a metre until "lost" was said for the first time, or for ever; after SE(3) alignment
    /// of the frames up to there.
    pub said_in_time: bool,
    /// Largest APE of the stretches before, between and after losses, each aligned by itself, metres.
    pub stretch_ape_m: f64,
}

impl Losses {
    /// Looks through the frames with a pose.
    pub(crate) fn of(frames: &[FrameResult]) -> Self {
        let losses = losses(frames);
        let mut stretches = Vec::new();
        let mut from = 0;
        for [first, last] in &losses {
            stretches.push(frames.get(from..*first).unwrap_or_default());
            from = last + 1;
        }
        stretches.push(frames.get(from..).unwrap_or_default());
        let until_said = stretches.first().copied().unwrap_or_default();
        let seconds = |[first, last]: &[usize; 2]| {
            let (first, last) = (frames.get(*first), frames.get(*last));
            first.zip(last).map_or(0.0, |(first, last)| {
                last.pose.frame.end_ns.saturating_sub(first.pose.frame.start_ns) as f64 * 1e-9
            })
        };
        Self {
            frames: frames.iter().filter(|frame| is_lost(frame)).count(),
            times: losses.len(),
            recovery_s: losses.iter().map(seconds).fold(0.0, f64::max),
            said_in_time: errors(until_said).iter().all(|error| *error <= ERROR_LIMIT_M),
            stretch_ape_m: stretches.iter().map(|stretch| rmse(&errors(stretch))).fold(0.0, f64::max),
        }
    }
}

/// First and last frame of each loss.
fn losses(frames: &[FrameResult]) -> Vec<[usize; 2]> {
    let mut losses: Vec<[usize; 2]> = Vec::new();
    let end_ns = |index: usize| frames.get(index).map_or(0, |frame| frame.pose.frame.end_ns);
    for index in (0..frames.len()).filter(|index| frames.get(*index).is_some_and(is_lost)) {
        match losses.last_mut() {
            Some([_, last]) if ((end_ns(index) - end_ns(*last)) as f64 * 1e-9) < PAUSE_S => *last = index,
            _ => losses.push([index, index]),
        }
    }
    losses
}

fn is_lost(frame: &FrameResult) -> bool {
    frame.pose.state == TrackingState::Lost as u32
}

fn errors(frames: &[FrameResult]) -> Vec<f64> {
    pairs(frames).map_or_else(Vec::new, |pairs| pairs.position_errors(&pairs.se3_alignment()))
}

fn rmse(errors: &[f64]) -> f64 {
    (errors.iter().map(|error| error * error).sum::<f64>() / errors.len().max(1) as f64).sqrt()
}

/// True and published poses; `None` where a pose is not finite or there is none.
pub(crate) fn pairs(frames: &[FrameResult]) -> Option<Pairs> {
    let stamps: Vec<_> = frames.iter().map(|frame| frame.pose.frame.end_ns).collect();
    let truth: Vec<_> = frames.iter().map(|frame| frame.truth).collect();
    let estimate: Vec<_> = frames.iter().map(|frame| map_from_lidar(&frame.pose)).collect();
    Pairs::from_poses(&stamps, &truth, &estimate).ok()
}

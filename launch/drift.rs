//! How far a trajectory ends from the truth, as summary.json says it.

use evac_evaluation::{Evaluation, EvaluationError, Pairs};
use evac_formats::tum::TumPose;
use serde::Serialize;

/// Drift of a trajectory against the truth; `evac eval` gives all figures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Drift {
    /// Frames compared.
    pub(crate) frames: usize,
    /// Length of the true path, metres.
    pub(crate) path_m: f64,
    /// Distance of the last poses after the first ones are laid on each other, metres.
    pub(crate) end_m: f64,
    /// The same as a share of the path.
    pub(crate) end_percent: f64,
    /// Angle between the last orientations after the first ones are laid on each other, degrees.
    pub(crate) end_rotation_deg: f64,
    /// Absolute position error (root mean square) after the best rigid alignment, metres.
    pub(crate) ape_rmse_m: f64,
    /// Largest absolute position error after the best rigid alignment, metres.
    pub(crate) ape_max_m: f64,
}

/// How poses of the same time are found.
pub(crate) type Associate = fn(&[TumPose], &[TumPose]) -> Result<Pairs, EvaluationError>;

/// Compares two trajectories of the LiDAR.
///
/// # Errors
/// Those of `associate`; `None` where fewer than two frames can be compared.
pub(crate) fn drift(
    truth: &[TumPose],
    estimate: &[TumPose],
    associate: Associate,
) -> Result<Option<Drift>, EvaluationError> {
    let evaluation = Evaluation::of(&associate(truth, estimate)?);
    Ok(evaluation.map(|evaluation| Drift {
        frames: evaluation.frames,
        path_m: evaluation.path_m,
        end_m: evaluation.end_m,
        end_percent: evaluation.end_percent,
        end_rotation_deg: evaluation.end_rotation_deg,
        ape_rmse_m: evaluation.ape_se3.rmse,
        ape_max_m: evaluation.ape_se3.max,
    }))
}

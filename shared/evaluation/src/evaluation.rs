//! All figures of a trajectory.

use serde::Serialize;

use crate::alignment::position;
use crate::{Figures, Pairs, RelativeError, Statistics};

/// All figures of a trajectory against the truth; definitions in the crate's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Evaluation {
    /// Frames compared.
    pub frames: usize,
    /// Length of the true path over these frames, metres.
    pub path_m: f64,
    /// Absolute position error after SE(3) alignment, metres.
    pub ape_se3: Statistics,
    /// Absolute position error after first-pose alignment, metres.
    pub ape_first: Statistics,
    /// Absolute rotation error after SE(3) alignment, degrees.
    pub rotation_se3_deg: Statistics,
    /// Absolute rotation error after first-pose alignment, degrees.
    pub rotation_first_deg: Statistics,
    /// Relative error over one second; none where no two frames are a second apart.
    pub rpe_1s: Option<RelativeError>,
    /// Relative error over one metre of true path; none where no two frames are a metre apart.
    pub rpe_1m: Option<RelativeError>,
    /// Distance of the last positions after first-pose alignment, metres.
    pub end_m: f64,
    /// The same as a share of the path, percent; 0 of a path without length.
    pub end_percent: f64,
    /// Angle between the last orientations after first-pose alignment, degrees.
    pub end_rotation_deg: f64,
    /// The estimate's height above the start after first-pose alignment, metres: what the paper's Table 1 gives.
    pub z_figures: Figures,
    /// Error of that height, estimate - truth, metres: the same where the floor is not level.
    pub z_error_figures: Figures,
}

impl Evaluation {
    /// `None` of fewer than two frames.
    pub fn of(pairs: &Pairs) -> Option<Self> {
        let (first, se3) = (pairs.first_pose_alignment(), pairs.se3_alignment());
        let (truth_start, truth_end) = (pairs.truth().first()?, pairs.truth().last()?);
        let aligned_end = first * pairs.estimate().last()?;
        let path_m = *pairs.true_path_m().last()?;
        let end_m = (position(&aligned_end) - position(truth_end)).norm();
        let estimated_z = || pairs.estimate().iter().map(|estimate| (first * estimate).translation.z);
        let heights: Vec<_> = estimated_z().map(|z| z - truth_start.translation.z).collect();
        let height_errors: Vec<_> =
            estimated_z().zip(pairs.truth()).map(|(z, truth)| z - truth.translation.z).collect();
        Some(Self {
            frames: pairs.len(),
            path_m,
            ape_se3: Statistics::of(&pairs.position_errors(&se3))?,
            ape_first: Statistics::of(&pairs.position_errors(&first))?,
            rotation_se3_deg: Statistics::of(&pairs.rotation_errors_deg(&se3))?,
            rotation_first_deg: Statistics::of(&pairs.rotation_errors_deg(&first))?,
            rpe_1s: RelativeError::per_second(pairs),
            rpe_1m: RelativeError::per_metre(pairs),
            end_m,
            end_percent: if path_m > 0.0 { 100.0 * end_m / path_m } else { 0.0 },
            end_rotation_deg: truth_end.rotation.angle_to(&aligned_end.rotation).to_degrees(),
            z_figures: Figures::of(&heights)?,
            z_error_figures: Figures::of(&height_errors)?,
        })
    }
}

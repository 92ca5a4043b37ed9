//! How a run compares with the truth.

use evac_evaluation::{Evaluation, Pairs};
use evac_frames::TrackingState;
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::{Isometry3, Vector3};
use serde::Serialize;

use crate::honesty::honesty;
use crate::loss::{Losses, pairs};
use crate::{Corners, FrameResult, Trajectory};

/// Figures of one run, from the first frame with a pose on. All zero where there is none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Figures {
    /// Frames with a pose.
    pub frames: usize,
    /// Seconds until the first pose.
    pub start_s: f64,
    /// Length of the true path, metres.
    pub path_m: f64,
    /// Root mean square of the position error after SE(3) alignment, metres.
    pub ape_m: f64,
    /// Largest of it, metres.
    pub ape_max_m: f64,
    /// Root mean square of the relative position error over one metre of path, metres.
    pub rpe_1m: f64,
    /// Error of the last position after first-pose alignment, metres.
    pub drift_m: f64,
    /// The same in percent of the path.
    pub drift_percent: f64,
    /// Error of the last orientation after first-pose alignment, degrees.
    pub rotation_deg: f64,
    /// Standard deviation of the height's error after SE(3) alignment, metres.
    pub z_std_m: f64,
    /// Share of frames whose position error is within three standard deviations of the published position along its
    /// worst axis; counted from the first pose.
    pub within_3_sigma: f64,
    /// The same along the error's own direction: its Mahalanobis length is at most 3.
    pub within_3_mahalanobis: f64,
    /// Largest length of a published step beyond the true one, metres.
    pub jump_m: f64,
    /// Frames in which a direction was said to be unobserved.
    pub degenerate: usize,
    /// What was said before blank walls.
    pub corners: Corners,
    /// When and how it was lost.
    pub losses: Losses,
    /// Time of the odometry a frame.
    #[serde(skip)]
    pub median_ms: f64,
    /// The same, 99th percentile.
    #[serde(skip)]
    pub p99_ms: f64,
    /// Median time of the deskewer a frame.
    #[serde(skip)]
    pub deskewer_median_ms: f64,
}

impl Figures {
    /// Figures of a run.
    pub fn of(run: &Trajectory) -> Self {
        let frames = run.tracked();
        let times = |of: fn(&FrameResult) -> f64| sorted(run.frames.iter().map(of));
        let (odometry, deskewer) = (times(|frame| frame.odometry_ms), times(|frame| frame.deskewer_ms));
        let timed = Self {
            median_ms: quantile(&odometry, 0.5),
            p99_ms: quantile(&odometry, 0.99),
            deskewer_median_ms: quantile(&deskewer, 0.5),
            ..Self::default()
        };
        let (Some(first), Some(start), Some(pairs)) = (run.frames.first(), frames.first(), pairs(frames))
        else {
            return timed;
        };
        let Some(evaluation) = Evaluation::of(&pairs) else { return timed };
        let (within_3_sigma, within_3_mahalanobis) = honesty(frames);
        Self {
            frames: frames.len(),
            start_s: start.pose.frame.end_ns.saturating_sub(first.pose.frame.start_ns) as f64 * 1e-9,
            path_m: evaluation.path_m,
            ape_m: evaluation.ape_se3.rmse,
            ape_max_m: evaluation.ape_se3.max,
            rpe_1m: evaluation.rpe_1m.map_or(0.0, |error| error.translation_m.rmse),
            drift_m: evaluation.end_m,
            drift_percent: evaluation.end_percent,
            rotation_deg: evaluation.end_rotation_deg,
            z_std_m: height_deviation(&pairs),
            within_3_sigma,
            within_3_mahalanobis,
            jump_m: frames.windows(2).map(jump).fold(0.0, f64::max),
            degenerate: frames.iter().filter(|f| f.pose.state == TrackingState::Degenerate as u32).count(),
            corners: Corners::of(run),
            losses: Losses::of(frames),
            ..timed
        }
    }
}

/// The alignment of the absolute error: a first pose that is a little tilted does not tilt the whole walk.
fn height_deviation(pairs: &Pairs) -> f64 {
    let alignment = pairs.se3_alignment();
    let height = |pose: &Isometry3<f64>| pose.translation.z;
    let errors: Vec<f64> = (pairs.truth().iter().zip(pairs.estimate()))
        .map(|(truth, estimate)| height(&(alignment * estimate)) - height(truth))
        .collect();
    let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    (errors.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / errors.len().max(1) as f64).sqrt()
}

fn jump(pair: &[FrameResult]) -> f64 {
    let [a, b] = pair else { return 0.0 };
    let step = |from: &Isometry3<f64>, to: &Isometry3<f64>| -> f64 {
        let (from, to): (Vector3<f64>, Vector3<f64>) = (from.translation.vector, to.translation.vector);
        (to - from).norm()
    };
    step(&map_from_lidar(&a.pose), &map_from_lidar(&b.pose)) - step(&a.truth, &b.truth)
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    sorted
}

/// Value below which `share` of the sorted values lie.
pub(crate) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let index = (sorted.len() as f64 * share) as usize;
    sorted.get(index.min(sorted.len().saturating_sub(1))).copied().unwrap_or(0.0)
}

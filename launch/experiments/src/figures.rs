//! How a run compares with the truth.

use evac_frames::{PoseFrame, TrackingState};
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::{Isometry3, Matrix3, Rotation3, SymmetricEigen, UnitQuaternion, Vector3};

use crate::{FrameResult, Trajectory};

/// "Lost" must be said before the error passes this, metres.
const ERROR_LIMIT_M: f64 = 0.5;
/// Largest APE of a run that was not lost, metres.
const APE_LIMIT_M: f64 = 0.2;
/// Time in which a lost odometry must recover, seconds.
const RECOVERY_LIMIT_S: f64 = 5.0;
/// Largest jump between two frames, metres.
const JUMP_LIMIT_M: f64 = 0.3;

/// Figures of one run, from the first frame with a pose on.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct Figures {
    /// Frames with a pose.
    pub frames: usize,
    /// Seconds until the first pose.
    pub start_s: f64,
    /// Length of the true path, metres.
    pub path_m: f64,
    /// Root mean square of the position error after rigid alignment, metres.
    pub ape_m: f64,
    /// Largest of it, metres.
    pub ape_max_m: f64,
    /// Error of the end relative to the start, metres.
    pub drift_m: f64,
    /// The same in percent of the path.
    pub drift_percent: f64,
    /// Error of the rotation from start to end, degrees.
    pub rotation_deg: f64,
    /// Standard deviation of the height's error after rigid alignment, metres.
    pub z_std_m: f64,
    /// Share of frames whose position error, laid over the truth at the first pose by place and heading, is within three
    /// standard deviations of the published position along its worst axis.
    pub within_3_sigma: f64,
    /// The same along the error's own direction: the error's Mahalanobis length is at most 3.
    pub within_3_mahalanobis: f64,
    /// Largest length of a published step beyond the true one, metres.
    pub jump_m: f64,
    /// Frames in each state.
    pub degenerate: usize,
    /// Frames in which "lost" was said.
    pub lost: usize,
    /// Longest time without a break in which "lost" was said, seconds.
    pub recovery_s: f64,
    /// Whether the error stayed below half a metre until "lost" was said, or for ever.
    pub said_in_time: bool,
    /// Median and 99th percentile of the odometry's time a frame, milliseconds.
    pub median_ms: f64,
    /// See above.
    pub p99_ms: f64,
    /// Median of the deskewer's.
    pub deskewer_median_ms: f64,
}

/// Whether a run holds what is asked of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The trajectory is good to 0.2 m without a jump.
    Held,
    /// It was lost, said so in time and recovered.
    Recovered,
    /// A stage refused the data with a reason.
    Refused,
    /// None of these.
    Failed,
}

impl Verdict {
    /// Judges a run by the rule for faulty walks.
    pub fn of(run: &Trajectory, figures: &Figures) -> Self {
        if run.refused.is_some() {
            return Self::Refused;
        }
        let recovered = figures.lost > 0 && figures.said_in_time && figures.recovery_s <= RECOVERY_LIMIT_S;
        match (figures.frames, figures.jump_m <= JUMP_LIMIT_M, figures.ape_m <= APE_LIMIT_M) {
            (0, _, _) | (_, false, _) => Self::Failed,
            (_, _, true) => Self::Held,
            (_, _, false) if recovered => Self::Recovered,
            _ => Self::Failed,
        }
    }
}

impl Figures {
    /// Figures of a run; all zero where it has no pose at all.
    pub fn of(run: &Trajectory) -> Self {
        let waiting = |frame: &&FrameResult| frame.pose.state == TrackingState::Initialising as u32;
        let before = run.frames.iter().take_while(waiting).count();
        let frames = run.frames.get(before..).unwrap_or_default();
        let (Some(first), Some(start), Some(end)) = (run.frames.first(), frames.first(), frames.last())
        else {
            return Self::default();
        };
        let errors = aligned_errors(frames);
        let norms: Vec<f64> = errors.iter().map(Vector3::norm).collect();
        let path_m: f64 = frames.windows(2).map(|pair| true_step(pair)).sum();
        let difference = between(&start.truth, &end.truth).inverse() * between(&pose(start), &pose(end));
        let drift_m = difference.translation.vector.norm();
        let heights: Vec<f64> = errors.iter().map(|error| error.z).collect();
        let lost = |frame: &&FrameResult| frame.pose.state == TrackingState::Lost as u32;
        let said = frames.iter().position(|frame| lost(&frame)).unwrap_or(frames.len());
        let until_said = aligned_errors(frames.get(..said).unwrap_or_default());
        let [odometry, deskewer] = [
            sorted(run.frames.iter().map(|frame| frame.odometry_ms)),
            sorted(run.frames.iter().map(|frame| frame.deskewer_ms)),
        ];
        let (within_3_sigma, within_3_mahalanobis) = honesty(frames);
        Self {
            frames: frames.len(),
            start_s: seconds(first, start),
            path_m,
            ape_m: mean(norms.iter().map(|error| error * error)).sqrt(),
            ape_max_m: norms.iter().copied().fold(0.0, f64::max),
            drift_m,
            drift_percent: 100.0 * drift_m / path_m.max(1e-9),
            rotation_deg: difference.rotation.angle().to_degrees(),
            z_std_m: (mean(heights.iter().map(|z| z * z)) - mean(heights.iter().copied()).powi(2))
                .max(0.0)
                .sqrt(),
            within_3_sigma,
            within_3_mahalanobis,
            jump_m: frames.windows(2).map(|pair| published_step(pair) - true_step(pair)).fold(0.0, f64::max),
            degenerate: frames.iter().filter(|f| f.pose.state == TrackingState::Degenerate as u32).count(),
            lost: frames.iter().filter(lost).count(),
            recovery_s: longest_loss(frames),
            said_in_time: until_said.iter().all(|error| error.norm() <= ERROR_LIMIT_M),
            median_ms: quantile(&odometry, 0.5),
            p99_ms: quantile(&odometry, 0.99),
            deskewer_median_ms: quantile(&deskewer, 0.5),
        }
    }
}

/// Shares of frames with an error within three of the published standard deviations: along the worst axis, and along the error.
/// Map and truth both have gravity, so that only place and heading of the first pose are laid over each other.
fn honesty(frames: &[FrameResult]) -> (f64, f64) {
    let Some(first) = frames.first() else { return (0.0, 0.0) };
    let turned = first.truth.rotation * pose(first).rotation.inverse();
    let q = turned.quaternion();
    let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 2.0 * q.k.atan2(q.w));
    let truth_from_map = |place: Vector3<f64>| {
        first.truth.translation.vector + heading * (place - pose(first).translation.vector)
    };
    let (mut worst_axis, mut own_direction) = (0, 0);
    for frame in frames {
        let error = truth_from_map(pose(frame).translation.vector) - frame.truth.translation.vector;
        let in_map = heading.inverse() * error;
        let covariance = position_covariance(&frame.pose);
        let largest = SymmetricEigen::new(covariance).eigenvalues.max();
        worst_axis += usize::from(error.norm() <= 3.0 * largest.max(0.0).sqrt());
        let squared = covariance.try_inverse().map(|inverse| in_map.dot(&(inverse * in_map)));
        own_direction += usize::from(squared.is_some_and(|squared| squared <= 9.0));
    }
    (worst_axis as f64 / frames.len() as f64, own_direction as f64 / frames.len() as f64)
}

fn position_covariance(pose: &PoseFrame) -> Matrix3<f64> {
    let c = &pose.covariance;
    Matrix3::new(c[0], c[1], c[2], c[6], c[7], c[8], c[12], c[13], c[14])
}

/// Position errors after the rigid motion that makes them smallest (Umeyama without scale).
fn aligned_errors(frames: &[FrameResult]) -> Vec<Vector3<f64>> {
    let place = |frame: &FrameResult| pose(frame).translation.vector;
    let truth = |frame: &FrameResult| frame.truth.translation.vector;
    let count = frames.len().max(1) as f64;
    let from = frames.iter().map(place).sum::<Vector3<f64>>() / count;
    let to = frames.iter().map(truth).sum::<Vector3<f64>>() / count;
    let cross: Matrix3<f64> =
        frames.iter().map(|frame| (truth(frame) - to) * (place(frame) - from).transpose()).sum();
    let svd = cross.svd(true, true);
    let (Some(u), Some(v)) = (svd.u, svd.v_t) else { return Vec::new() };
    let handed = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v).determinant().signum()));
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * handed * v));
    frames.iter().map(|frame| rotation * (place(frame) - from) + to - truth(frame)).collect()
}

fn pose(frame: &FrameResult) -> Isometry3<f64> {
    map_from_lidar(&frame.pose)
}

fn between(from: &Isometry3<f64>, to: &Isometry3<f64>) -> Isometry3<f64> {
    from.inverse() * to
}

fn true_step(pair: &[FrameResult]) -> f64 {
    match pair {
        [a, b] => (b.truth.translation.vector - a.truth.translation.vector).norm(),
        _ => 0.0,
    }
}

fn published_step(pair: &[FrameResult]) -> f64 {
    match pair {
        [a, b] => (Vector3::from(b.pose.position) - Vector3::from(a.pose.position)).norm(),
        _ => 0.0,
    }
}

fn longest_loss(frames: &[FrameResult]) -> f64 {
    let lost = |frame: &FrameResult| frame.pose.state == TrackingState::Lost as u32;
    frames
        .chunk_by(|a, b| lost(a) == lost(b))
        .filter(|run| run.first().is_some_and(lost))
        .filter_map(|run| Some(run.last()?.pose.frame.end_ns - run.first()?.pose.frame.start_ns))
        .max()
        .map_or(0.0, |longest| longest as f64 * 1e-9)
}

fn seconds(from: &FrameResult, to: &FrameResult) -> f64 {
    to.pose.frame.end_ns.saturating_sub(from.pose.frame.start_ns) as f64 * 1e-9
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    sorted
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    let index = (sorted.len() as f64 * share) as usize;
    sorted.get(index.min(sorted.len().saturating_sub(1))).copied().unwrap_or(0.0)
}

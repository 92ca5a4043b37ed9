//! Poses of the same time.

use evac_formats::tum::TumPose;
use evac_geometry::nalgebra::Isometry3;
use evac_geometry::{Interpolation, isometry};

use crate::alignment::position;
use crate::{EvaluationError, Side};

/// Between true poses farther apart the truth is not known, nanoseconds: a walker turns a corner within that.
const MAX_TRUTH_GAP_NS: i64 = 1_000_000_000;
/// Stamps this close beyond the truth's ends are rounding and no reason to lose a frame, nanoseconds.
const ROUNDING_NS: u64 = 1_000_000;

/// True and estimated poses of the same times, in the order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Pairs {
    stamps_ns: Vec<i64>,
    truth: Vec<Isometry3<f64>>,
    estimate: Vec<Isometry3<f64>>,
    offset_ns: i64,
    without_truth: usize,
}

impl Pairs {
    /// Pairs of a run that has both at the same times already; `stamps_ns` is each frame's time.
    ///
    /// # Errors
    /// [`EvaluationError`] where the lengths differ, times do not increase or a pose is not finite.
    pub fn from_poses(
        stamps_ns: &[i64],
        truth: &[Isometry3<f64>],
        estimate: &[Isometry3<f64>],
    ) -> Result<Self, EvaluationError> {
        if stamps_ns.len() != truth.len() || truth.len() != estimate.len() {
            let (stamps, truth, estimate) = (stamps_ns.len(), truth.len(), estimate.len());
            return Err(EvaluationError::Lengths { stamps, truth, estimate });
        }
        increasing(Side::Estimate, stamps_ns.iter().copied())?;
        let numbers = |pose: &Isometry3<f64>| {
            pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|number| number.is_finite())
        };
        finite(Side::Truth, truth.iter().map(numbers))?;
        finite(Side::Estimate, estimate.iter().map(numbers))?;
        Ok(Self {
            stamps_ns: stamps_ns.to_vec(),
            truth: truth.to_vec(),
            estimate: estimate.to_vec(),
            offset_ns: 0,
            without_truth: 0,
        })
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.stamps_ns.len()
    }

    /// Whether there is no frame.
    pub fn is_empty(&self) -> bool {
        self.stamps_ns.is_empty()
    }

    /// Each frame's time as the estimate stamps it, nanoseconds.
    pub fn stamps_ns(&self) -> &[i64] {
        &self.stamps_ns
    }

    /// True pose of each frame, in the truth's own frame of reference.
    pub fn truth(&self) -> &[Isometry3<f64>] {
        &self.truth
    }

    /// Estimated pose of each frame, in the estimate's own frame of reference.
    pub fn estimate(&self) -> &[Isometry3<f64>] {
        &self.estimate
    }

    /// What was added to the estimate's stamps to find the true pose, nanoseconds.
    pub fn offset_ns(&self) -> i64 {
        self.offset_ns
    }

    /// Estimated poses that were left out: the truth does not cover their time, or has a gap of over 1 s there.
    pub fn without_truth(&self) -> usize {
        self.without_truth
    }

    /// True path from the first frame to each frame, metres.
    pub fn true_path_m(&self) -> Vec<f64> {
        let mut before = None;
        let mut path = 0.0;
        self.truth
            .iter()
            .map(|pose| {
                let here = position(pose);
                path += before.replace(here).map_or(0.0, |before| (here - before).norm());
                path
            })
            .collect()
    }
}

/// Pairs each estimated pose with the true one at the same time since the first pose of its trajectory. Clocks may so
/// differ by a constant, but both trajectories must begin at the same moment.
///
/// Between two true poses at most 1 s apart the truth is interpolated.
///
/// # Errors
/// [`EvaluationError`] where a trajectory has fewer than 2 poses, does not increase in time or is not finite, or where the truth
/// is known at fewer than 2 of the estimate's poses.
pub fn associate(truth: &[TumPose], estimate: &[TumPose]) -> Result<Pairs, EvaluationError> {
    let first = |poses: &[TumPose]| poses.first().map_or(0, |pose| pose.stamp_ns);
    let remedy =
        "check that both are of the same walk, or compare stamps as they are where both clocks are one";
    pair(truth, estimate, first(truth).saturating_sub(first(estimate)), remedy)
}

/// As [`associate`], but with the stamps as they are: both trajectories are on one clock and may begin at different moments.
///
/// # Errors
/// As [`associate`].
pub fn associate_absolute(truth: &[TumPose], estimate: &[TumPose]) -> Result<Pairs, EvaluationError> {
    let remedy =
        "check that both are of the same walk, or count times from the first poses where the clocks differ";
    pair(truth, estimate, 0, remedy)
}

fn pair(
    truth: &[TumPose],
    estimate: &[TumPose],
    offset_ns: i64,
    remedy: &'static str,
) -> Result<Pairs, EvaluationError> {
    let truth_ns = check(Side::Truth, truth)?;
    let estimate_ns = check(Side::Estimate, estimate)?;
    let track = Interpolation::new(truth.iter().map(|pose| (pose.stamp_ns, isometry_of(pose))).collect());
    let mut pairs = Pairs {
        stamps_ns: Vec::with_capacity(estimate.len()),
        truth: Vec::with_capacity(estimate.len()),
        estimate: Vec::with_capacity(estimate.len()),
        offset_ns,
        without_truth: 0,
    };
    for pose in estimate {
        let at = pose.stamp_ns.saturating_add(offset_ns);
        match known(truth, at).and_then(|at| track.at(at)) {
            Some(true_pose) => {
                pairs.stamps_ns.push(pose.stamp_ns);
                pairs.truth.push(true_pose);
                pairs.estimate.push(isometry_of(pose));
            }
            None => pairs.without_truth += 1,
        }
    }
    if pairs.len() < 2 {
        let gap = |pair: &[TumPose]| matches!(pair, [a, b] if is_gap(a, b));
        let gaps = truth.windows(2).filter(|pair| gap(pair)).count();
        return Err(EvaluationError::NoOverlap { truth_ns, estimate_ns, gaps, matched: pairs.len(), remedy });
    }
    Ok(pairs)
}

/// First and last time of a trajectory that can be used.
fn check(side: Side, poses: &[TumPose]) -> Result<[i64; 2], EvaluationError> {
    let (Some(first), Some(last), 2..) = (poses.first(), poses.last(), poses.len()) else {
        return Err(EvaluationError::TooFew { side, poses: poses.len() });
    };
    increasing(side, poses.iter().map(|pose| pose.stamp_ns))?;
    let numbers =
        |pose: &TumPose| pose.position.iter().chain(&pose.orientation).all(|number| number.is_finite());
    finite(side, poses.iter().map(numbers))?;
    Ok([first.stamp_ns, last.stamp_ns])
}

fn increasing(side: Side, stamps: impl Iterator<Item = i64>) -> Result<(), EvaluationError> {
    let mut before = None;
    for (pose, stamp_ns) in (1..).zip(stamps) {
        match before.replace(stamp_ns) {
            Some(before_ns) if stamp_ns <= before_ns => {
                return Err(EvaluationError::NotMonotonic { side, pose, stamp_ns, before_ns });
            }
            _ => {}
        }
    }
    Ok(())
}

fn finite(side: Side, poses: impl Iterator<Item = bool>) -> Result<(), EvaluationError> {
    match (1..).zip(poses).find(|(_, finite)| !finite) {
        Some((pose, _)) => Err(EvaluationError::NotFinite { side, pose }),
        None => Ok(()),
    }
}

/// The time at which the truth is read for `at`; `None` where it is not known then.
fn known(truth: &[TumPose], at: i64) -> Option<i64> {
    let after = truth.partition_point(|pose| pose.stamp_ns < at);
    let neighbours = [after.checked_sub(1), Some(after)].map(|index| index.and_then(|i| truth.get(i)));
    match neighbours {
        [Some(before), Some(after)] if !is_gap(before, after) => Some(at),
        _ => {
            let near = |pose: &&TumPose| pose.stamp_ns.abs_diff(at) <= ROUNDING_NS;
            neighbours.into_iter().flatten().find(near).map(|pose| pose.stamp_ns)
        }
    }
}

fn is_gap(a: &TumPose, b: &TumPose) -> bool {
    b.stamp_ns.saturating_sub(a.stamp_ns) > MAX_TRUTH_GAP_NS
}

fn isometry_of(pose: &TumPose) -> Isometry3<f64> {
    isometry(pose.position, pose.orientation)
}

//! Why two trajectories cannot be compared.

use std::fmt;

/// Which of the two trajectories.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// What is taken as true.
    Truth,
    /// What is evaluated.
    Estimate,
}

impl fmt::Display for Side {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Truth => "the truth",
            Self::Estimate => "the estimate",
        })
    }
}

/// Why two trajectories cannot be compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EvaluationError {
    /// Nothing can be said about fewer than two poses.
    #[error(
        "{side} has too few poses ({poses}, at least 2 are needed); check that the run wrote its whole trajectory"
    )]
    TooFew {
        /// Which trajectory.
        side: Side,
        /// Its poses.
        poses: usize,
    },
    /// Times must increase from pose to pose.
    #[error(
        "{side}: pose {pose} is stamped {} s, not after {} s before it; sort the poses by time and leave one of each time",
        Seconds(*stamp_ns), Seconds(*before_ns)
    )]
    NotMonotonic {
        /// Which trajectory.
        side: Side,
        /// Number of the pose that goes back, from 1.
        pose: usize,
        /// Its time, nanoseconds.
        stamp_ns: i64,
        /// The time of the pose before, nanoseconds.
        before_ns: i64,
    },
    /// A number is infinite or none.
    #[error("{side}: pose {pose} is not finite; leave it out")]
    NotFinite {
        /// Which trajectory.
        side: Side,
        /// Number of the pose, from 1.
        pose: usize,
    },
    /// Stamps, truth and estimate do not belong together.
    #[error(
        "{stamps} stamps, {truth} true and {estimate} estimated poses; one of each is needed for every frame"
    )]
    Lengths {
        /// Stamps given.
        stamps: usize,
        /// True poses given.
        truth: usize,
        /// Estimated poses given.
        estimate: usize,
    },
    /// At fewer than two poses of the estimate the truth is known.
    #[error(
        "the truth covers {} s to {} s{}, the estimate {} s to {} s: {matched} of its poses have a true one; {remedy}",
        Seconds(truth_ns[0]), Seconds(truth_ns[1]), Gaps(*gaps), Seconds(estimate_ns[0]), Seconds(estimate_ns[1])
    )]
    NoOverlap {
        /// First and last time of the truth, nanoseconds.
        truth_ns: [i64; 2],
        /// First and last time of the estimate, nanoseconds.
        estimate_ns: [i64; 2],
        /// Gaps of the truth that are too long to interpolate.
        gaps: usize,
        /// Poses of the estimate at which the truth is known.
        matched: usize,
        /// What to try.
        remedy: &'static str,
    },
}

struct Seconds(i64);

impl fmt::Display for Seconds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let ns = self.0.unsigned_abs();
        write!(f, "{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
    }
}

struct Gaps(usize);

impl fmt::Display for Gaps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 => Ok(()),
            gaps => write!(f, " with {gaps} gaps of over 1 s"),
        }
    }
}

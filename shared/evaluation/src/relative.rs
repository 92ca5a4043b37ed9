//! Relative pose error: drift over a second and over a metre.

use evac_geometry::nalgebra::Isometry3;
use serde::Serialize;

use crate::Pairs;
use crate::alignment::position;
use crate::statistics::Statistics;

/// How far from a second two frames may be, seconds: at 7.2 Hz and above every frame has a partner.
const SECOND_TOLERANCE: f64 = 0.07;
/// How far from a metre of path two frames may be, metres; evo's default of 10 %.
const METRE_TOLERANCE: f64 = 0.1;

/// Error of the motion between two frames, over all pairs of frames a given interval apart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RelativeError {
    /// Pairs of frames.
    pub pairs: usize,
    /// Error of the displacement, metres.
    pub translation_m: Statistics,
    /// Error of the turn, degrees.
    pub rotation_deg: Statistics,
}

impl RelativeError {
    /// Over one second: each frame with the one nearest to a second later. `None` where no two frames are 1 +- 0.07 s
    /// apart.
    pub fn per_second(pairs: &Pairs) -> Option<Self> {
        let first = *pairs.stamps_ns().first()?;
        let seconds = |stamp: &i64| stamp.saturating_sub(first) as f64 * 1e-9;
        Self::over(pairs, &pairs.stamps_ns().iter().map(seconds).collect::<Vec<_>>(), SECOND_TOLERANCE)
    }

    /// Over one metre of the true path: each frame with the one nearest to a metre further. `None` where no two frames
    /// are 1 +- 0.1 m of path apart.
    pub fn per_metre(pairs: &Pairs) -> Option<Self> {
        Self::over(pairs, &pairs.true_path_m(), METRE_TOLERANCE)
    }

    /// Over pairs whose marks, which never fall, are 1 apart.
    fn over(pairs: &Pairs, marks: &[f64], tolerance: f64) -> Option<Self> {
        let errors: Vec<_> = (0..marks.len())
            .filter_map(|i| {
                let j = one_further(marks, i, tolerance)?;
                let between = |poses: &[Isometry3<f64>]| Some(poses.get(i)?.inverse() * poses.get(j)?);
                Some(between(pairs.truth())?.inverse() * between(pairs.estimate())?)
            })
            .collect();
        let translations: Vec<_> = errors.iter().map(|error| position(error).norm()).collect();
        let rotations: Vec<_> = errors.iter().map(|error| error.rotation.angle().to_degrees()).collect();
        Some(Self {
            pairs: errors.len(),
            translation_m: Statistics::of(&translations)?,
            rotation_deg: Statistics::of(&rotations)?,
        })
    }
}

/// The frame after `i` whose mark is nearest to one more than that of `i`, the first of equal ones.
fn one_further(marks: &[f64], i: usize, tolerance: f64) -> Option<usize> {
    let target = marks.get(i)? + 1.0;
    let later = marks.get(i + 1..)?;
    let above = later.partition_point(|mark| *mark < target);
    // Standing frames have one mark: the first of them counts.
    let below = above.checked_sub(1).and_then(|last| {
        let mark = later.get(last)?;
        Some(later.partition_point(|other| other < mark))
    });
    let distance = |at: usize| later.get(at).map(|mark| ((mark - target).abs(), at));
    let nearest = match (below.and_then(distance), distance(above)) {
        (Some(below), Some(above)) => Some(if above.0 < below.0 { above } else { below }),
        (below, above) => below.or(above),
    };
    nearest.filter(|(distance, _)| *distance <= tolerance).map(|(_, at)| i + 1 + at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_frame_is_taken_and_none_beyond_the_tolerance() {
        let marks = [0.0, 0.4, 0.98, 1.03, 1.37, 2.5];
        assert_eq!(one_further(&marks, 0, 0.1), Some(2));
        assert_eq!(one_further(&marks, 1, 0.1), Some(4));
        assert_eq!(one_further(&marks, 2, 0.1), None);
        assert_eq!(one_further(&marks, 5, 0.1), None);
    }

    #[test]
    fn of_frames_that_stand_still_the_first_is_taken() {
        assert_eq!(one_further(&[0.0, 0.0, 0.95, 0.95, 0.95], 1, 0.1), Some(2));
        assert_eq!(one_further(&[0.0, 1.0, 1.0], 0, 0.1), Some(1));
    }
}

//! How far a trajectory ends from the truth.

use evac_formats::tum::TumPose;
use evac_geometry::nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use evac_geometry::{Interpolation, isometry, log_so3};
use serde::Serialize;

/// Stamps farther apart than this are not one frame.
const MAX_STAMP_DIFFERENCE_NS: i64 = 50_000_000;

/// Drift of a trajectory against the truth.
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

/// Compares two trajectories of the LiDAR. Their times may differ by a constant: both are counted from their first pose.
/// `None` where fewer than two frames can be compared.
pub(crate) fn drift(truth: &[TumPose], estimate: &[TumPose]) -> Option<Drift> {
    let pairs = pairs(truth, estimate);
    let ((first_truth, first), (last_truth, last)) = (pairs.first()?, pairs.last()?);
    if pairs.len() < 2 {
        return None;
    }
    let error = (first_truth.inverse() * last_truth).inverse() * (first.inverse() * last);
    let steps = pairs.windows(2).map(|pair| match pair {
        [(a, _), (b, _)] => (b.translation.vector - a.translation.vector).norm(),
        _ => 0.0,
    });
    let path_m: f64 = steps.sum();
    let end_m = error.translation.vector.norm();
    let alignment = align(&pairs);
    let errors = pairs.iter().map(|(truth, estimate)| {
        (alignment * estimate.translation.vector - truth.translation.vector).norm_squared()
    });
    let (sum, max) = errors.fold((0.0, 0.0_f64), |(sum, max), e| (sum + e, max.max(e)));
    Some(Drift {
        frames: pairs.len(),
        path_m,
        end_m,
        end_percent: if path_m > 0.0 { 100.0 * end_m / path_m } else { 0.0 },
        end_rotation_deg: log_so3(&error.rotation).norm().to_degrees(),
        ape_rmse_m: (sum / pairs.len() as f64).sqrt(),
        ape_max_m: max.sqrt(),
    })
}

type Pair = (Isometry3<f64>, Isometry3<f64>);

/// Truth and estimate at the same time since the start. Where the truth is sparser than the frames it is interpolated.
fn pairs(truth: &[TumPose], estimate: &[TumPose]) -> Vec<Pair> {
    let pose = |p: &TumPose| isometry(p.position, p.orientation);
    let (Some(t0), Some(e0)) = (truth.first(), estimate.first()) else { return Vec::new() };
    let track = Interpolation::new(truth.iter().map(|p| (p.stamp_ns - t0.stamp_ns, pose(p))).collect());
    let last_ns = truth.last().map_or(0, |p| p.stamp_ns - t0.stamp_ns);
    estimate
        .iter()
        .filter_map(|p| {
            let since = p.stamp_ns - e0.stamp_ns;
            // A few nanoseconds of rounding at the last frame are no reason to lose it.
            let at =
                if since > last_ns && since - last_ns < MAX_STAMP_DIFFERENCE_NS { last_ns } else { since };
            Some((track.at(at)?, pose(p)))
        })
        .collect()
}

/// Rigid transform that lays the estimated positions best on the true ones (Umeyama 1991, without scale).
fn align(pairs: &[Pair]) -> impl std::ops::Mul<Vector3<f64>, Output = Vector3<f64>> + Copy {
    let mean =
        |pick: fn(&Pair) -> Vector3<f64>| pairs.iter().map(pick).sum::<Vector3<f64>>() / pairs.len() as f64;
    let (truth_mean, mean) = (mean(|p| p.0.translation.vector), mean(|p| p.1.translation.vector));
    let covariance: Matrix3<f64> = pairs
        .iter()
        .map(|(t, e)| (t.translation.vector - truth_mean) * (e.translation.vector - mean).transpose())
        .sum();
    let svd = covariance.svd(true, true);
    let rotation = match (svd.u, svd.v_t) {
        (Some(u), Some(v_t)) => {
            let sign = (u.determinant() * v_t.determinant()).signum();
            u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t
        }
        _ => Matrix3::identity(),
    };
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Alignment { rotation, shift: truth_mean - rotation * mean }
}

#[derive(Debug, Clone, Copy)]
struct Alignment {
    rotation: UnitQuaternion<f64>,
    shift: Vector3<f64>,
}

impl std::ops::Mul<Vector3<f64>> for Alignment {
    type Output = Vector3<f64>;

    fn mul(self, point: Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.shift
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 4 x 10 m, one pose a metre, seen from a map frame that is turned and starts at another time.
    fn square(end_error: f64) -> (Vec<TumPose>, Vec<TumPose>) {
        let map = Isometry3::new(Vector3::new(5.0, -2.0, 1.0), Vector3::new(0.1, 0.2, 1.5));
        let corner = |i: i64| match i / 10 {
            0 => (i as f64, 0.0),
            1 => (10.0, (i - 10) as f64),
            2 => ((30 - i) as f64, 10.0),
            _ => (0.0, (40 - i) as f64),
        };
        let tum = |stamp_ns, pose: Isometry3<f64>| TumPose {
            stamp_ns,
            position: pose.translation.vector.into(),
            orientation: pose.rotation.coords.into(),
        };
        let poses = (0..=40).map(|i| Isometry3::translation(corner(i).0, corner(i).1, 0.0));
        let mut estimate: Vec<_> =
            poses.clone().enumerate().map(|(i, p)| tum(i as i64 * 100_000_000, map * p)).collect();
        estimate[40].position[2] += end_error;
        (
            poses
                .enumerate()
                .map(|(i, p)| tum(1_700_000_000_000_000_000 + i as i64 * 100_000_000, p))
                .collect(),
            estimate,
        )
    }

    #[test]
    fn a_turned_and_shifted_copy_has_no_drift() {
        let (truth, estimate) = square(0.0);
        let drift = drift(&truth, &estimate).unwrap();
        assert_eq!(drift.frames, 41);
        assert!((drift.path_m - 40.0).abs() < 1e-9);
        assert!(drift.end_m < 1e-9 && drift.ape_rmse_m < 1e-9 && drift.end_rotation_deg < 1e-6, "{drift:?}");
    }

    #[test]
    fn the_end_error_is_a_share_of_the_path() {
        let (truth, estimate) = square(0.4);
        let drift = drift(&truth, &estimate).unwrap();
        assert!((drift.end_m - 0.4).abs() < 1e-9 && (drift.end_percent - 1.0).abs() < 1e-9, "{drift:?}");
        assert!(drift.ape_rmse_m > 0.01 && drift.ape_max_m < 0.4);
    }

    #[test]
    fn nothing_to_compare_gives_nothing() {
        assert_eq!(drift(&[], &square(0.0).1), None);
    }
}

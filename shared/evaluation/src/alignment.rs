//! Laying an estimate on the truth.

use evac_geometry::nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::Pairs;

/// Share of the covariance that keeps the first poses' rotation where the path leaves it open.
const TIE_BREAK: f64 = 1e-10;

impl Pairs {
    /// `truth_from_estimate` that lays the first estimated pose on the first true one; identity of no pairs.
    pub fn first_pose_alignment(&self) -> Isometry3<f64> {
        let first = self.truth().first().zip(self.estimate().first());
        first.map_or_else(Isometry3::identity, |(truth, estimate)| truth * estimate.inverse())
    }

    /// `truth_from_estimate` with the least squared distances between true and estimated positions (Umeyama 1991, no
    /// scale). About a straight path every rotation is as good; there the first poses decide.
    pub fn se3_alignment(&self) -> Isometry3<f64> {
        let start = self.first_pose_alignment();
        let positions =
            || self.truth().iter().zip(self.estimate()).map(|(t, e)| (position(t), position(&(start * e))));
        let n = self.len().max(1) as f64;
        let (truth_sum, sum) =
            positions().fold((Vector3::zeros(), Vector3::zeros()), |(a, b), (t, e)| (a + t, b + e));
        let (truth_mean, mean) = (truth_sum / n, sum / n);
        let mut covariance: Matrix3<f64> =
            positions().map(|(t, e)| (t - truth_mean) * (e - mean).transpose() / n).sum();
        covariance += Matrix3::identity() * (covariance.norm() * TIE_BREAK + f64::MIN_POSITIVE);
        let rotation = closest_rotation(covariance);
        Isometry3::from_parts(Translation3::from(truth_mean - rotation * mean), rotation) * start
    }

    /// Distance of each aligned position from the true one, metres, frame by frame.
    pub fn position_errors(&self, truth_from_estimate: &Isometry3<f64>) -> Vec<f64> {
        self.errors(truth_from_estimate, |truth, estimate| (position(estimate) - position(truth)).norm())
    }

    /// Angle of each aligned orientation from the true one, degrees, frame by frame.
    pub fn rotation_errors_deg(&self, truth_from_estimate: &Isometry3<f64>) -> Vec<f64> {
        self.errors(truth_from_estimate, |truth, estimate| {
            truth.rotation.angle_to(&estimate.rotation).to_degrees()
        })
    }

    fn errors(
        &self,
        alignment: &Isometry3<f64>,
        error: impl Fn(&Isometry3<f64>, &Isometry3<f64>) -> f64,
    ) -> Vec<f64> {
        self.truth().iter().zip(self.estimate()).map(|(t, e)| error(t, &(alignment * e))).collect()
    }
}

pub(crate) fn position(pose: &Isometry3<f64>) -> Vector3<f64> {
    pose.translation.vector
}

/// The rotation with the largest trace of `R^T covariance` (Umeyama 1991, equations 39 and 40).
fn closest_rotation(covariance: Matrix3<f64>) -> UnitQuaternion<f64> {
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return UnitQuaternion::identity() };
    // The last singular value is the least, so a mirroring costs least there.
    let sign = (u.determinant() * v_t.determinant()).signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation))
}

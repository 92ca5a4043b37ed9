//! Whether errors are as large as the odometry says.

use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::{Matrix3, SymmetricEigen};

use crate::FrameResult;

/// Shares of frames with a position error within three of the published standard deviations: along the worst axis, and along the
/// error itself. Errors count from the first pose, position and orientation, as the published covariance does.
pub(crate) fn honesty(frames: &[FrameResult]) -> (f64, f64) {
    let Some(first) = frames.first() else { return (0.0, 0.0) };
    let map_from_truth = map_from_lidar(&first.pose) * first.truth.inverse();
    let (mut worst_axis, mut own_direction) = (0, 0);
    for frame in frames {
        // In the map frame, as the covariance is.
        let truly = (map_from_truth * frame.truth).translation.vector;
        let error = map_from_lidar(&frame.pose).translation.vector - truly;
        let covariance = position_covariance(&frame.pose.covariance);
        let largest = SymmetricEigen::new(covariance).eigenvalues.max();
        worst_axis += usize::from(error.norm() <= 3.0 * largest.max(0.0).sqrt());
        let squared = covariance.try_inverse().map(|inverse| error.dot(&(inverse * error)));
        own_direction += usize::from(squared.is_some_and(|squared| squared <= 9.0));
    }
    let count = frames.len() as f64;
    (worst_axis as f64 / count, own_direction as f64 / count)
}

fn position_covariance(c: &[f64; 36]) -> Matrix3<f64> {
    Matrix3::new(c[0], c[1], c[2], c[6], c[7], c[8], c[12], c[13], c[14])
}

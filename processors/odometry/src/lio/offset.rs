//! A displacement of the map as the pose error that it looks like, and back.

use evac_geometry::nalgebra::{Matrix3, SMatrix};
use evac_geometry::skew;

use super::state::State;

/// Covariance of a pose error: rotation (IMU frame), position. Of a section's place: rotation (map axes), displacement.
pub(crate) type PoseCovariance = SMatrix<f64, 6, 6>;

/// The pose error that a displacement of the map looks like from the present pose.
pub(crate) fn pose_by_offset(state: &State) -> PoseCovariance {
    let mut map = PoseCovariance::zeros();
    let imu_from_map = state.rotation.inverse().to_rotation_matrix();
    map.fixed_view_mut::<3, 3>(0, 0).copy_from(imu_from_map.matrix());
    map.fixed_view_mut::<3, 3>(3, 0).copy_from(&-skew(&state.position));
    map.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::identity());
    map
}

/// The inverse of [`pose_by_offset`].
pub(crate) fn offset_by_pose(state: &State) -> PoseCovariance {
    let rotation = state.rotation.to_rotation_matrix();
    let mut map = PoseCovariance::zeros();
    map.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation.matrix());
    map.fixed_view_mut::<3, 3>(3, 0).copy_from(&(skew(&state.position) * rotation.matrix()));
    map.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::identity());
    map
}

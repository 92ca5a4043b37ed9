//! The pose frame: what the filter knows, in the words of the pipeline.

use evac_frames::{FrameHeader, PoseFrame, TrackingState};
use evac_geometry::nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use evac_geometry::{set_map_from_imu, set_map_from_lidar, skew};

use super::degeneracy::Degeneracy;
use super::offset::PoseCovariance;
use super::state::State;

/// Observed errors are 1.5 to 2.5 of the filter's own standard deviations (design section 5.7): twice is published.
const HONESTY: f64 = 2.0;

/// Pose frame of a running filter.
pub(crate) fn pose_frame(
    frame: &FrameHeader,
    state: &State,
    covariance: [f64; 36],
    imu_from_lidar: &Isometry3<f64>,
    degeneracy: &Degeneracy,
    quality: f64,
    tracking: TrackingState,
) -> PoseFrame {
    let map_from_imu = state.map_from_imu();
    let mut pose = PoseFrame {
        frame: *frame,
        velocity: state.velocity.into(),
        gyro_bias: state.gyro_bias.into(),
        accel_bias: state.accel_bias.into(),
        gravity: state.gravity.into(),
        covariance,
        time_offset_ns: state.offset_ns(),
        quality: quality as f32,
        degenerate: degeneracy.count as u32,
        state: tracking as u32,
        ..PoseFrame::default()
    };
    for (to, axis) in pose.degenerate_axes.iter_mut().zip(degeneracy.axes.iter().take(degeneracy.count)) {
        *to = (*axis).into();
    }
    set_map_from_imu(&mut pose, &map_from_imu);
    set_map_from_lidar(&mut pose, &(map_from_imu * imu_from_lidar));
    pose
}

/// Published standard deviation of the time offset, microseconds, from its variance in s^2; 0 says that it is not estimated.
pub(crate) fn sigma_us(variance: f64) -> u32 {
    (HONESTY * variance.max(0.0).sqrt() * 1e6).ceil() as u32
}

/// Pose frame before the start: the LiDAR at the map's origin, upright as far as gravity is known.
pub(crate) fn waiting_frame(
    frame: &FrameHeader,
    map_from_imu_rotation: &UnitQuaternion<f64>,
    imu_from_lidar: &Isometry3<f64>,
) -> PoseFrame {
    let mut pose = PoseFrame {
        frame: *frame,
        gravity: [0.0, 0.0, -evac_geometry::STANDARD_GRAVITY],
        state: TrackingState::Initialising as u32,
        ..PoseFrame::default()
    };
    let rotation = map_from_imu_rotation * imu_from_lidar.rotation;
    let map_from_lidar = Isometry3::from_parts(Vector3::zeros().into(), rotation);
    set_map_from_lidar(&mut pose, &map_from_lidar);
    set_map_from_imu(&mut pose, &(map_from_lidar * imu_from_lidar.inverse()));
    pose
}

/// Covariance of the LiDAR's pose with rotation about the map's axes, row-major, from that of the IMU's: with lever
/// arm `t`, `dp_lidar = dp - R [t]x dtheta` and `dphi = R dtheta`.
pub(crate) fn lidar_covariance(
    state: &State,
    pose: &PoseCovariance,
    imu_from_lidar: &Isometry3<f64>,
) -> [f64; 36] {
    let rotation = state.rotation.to_rotation_matrix();
    let mut jacobian = PoseCovariance::zeros();
    let lever = -(rotation.matrix() * skew(&imu_from_lidar.translation.vector));
    jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&lever);
    jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
    jacobian.fixed_view_mut::<3, 3>(3, 0).copy_from(rotation.matrix());
    let lidar = jacobian * pose * jacobian.transpose() * HONESTY.powi(2);
    let mut row_major = [0.0; 36];
    for (i, value) in row_major.iter_mut().enumerate() {
        *value = lidar[(i / 6, i % 6)];
    }
    row_major
}

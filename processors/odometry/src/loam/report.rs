//! The pose frame: what the filter knows, in the words of the pipeline.

use evac_frames::{FrameHeader, PoseFrame, TrackingState};
use evac_geometry::nalgebra::{Isometry3, Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};
use evac_geometry::{STANDARD_GRAVITY, set_map_from_imu, set_map_from_lidar, skew};

use super::filter::{Filter, PoseInformation};
use super::observability::Degeneracy;

/// Twice the filter's standard deviation is published: a scan's residuals have common causes.
const HONESTY: f64 = 2.0;
/// Drift where everything is observed, as share of the way and rad per sqrt(m).
const DRIFT_SHARE: f64 = 0.004;
const TURN_PER_SQRT_M: f64 = 7e-4;

/// What the map has inherited from poses that were not well known: a match with it cannot be better.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Drift {
    way: f64,
    /// Variances left by finished stretches without full observation, position and rotation along the map's axes.
    past: SVector<f64, 6>,
    /// The largest of the present stretch.
    peak: SVector<f64, 6>,
}

impl Drift {
    /// Counts a frame that moved by `step` metres; `blind` says that a direction was not observed.
    pub(crate) fn count(&mut self, filter: &Filter, step: f64, blind: bool) {
        self.way += step;
        if blind {
            self.peak = self.peak.zip_map(&filter.covariance.diagonal().fixed_rows::<6>(0), f64::max);
        } else {
            self.past += self.peak;
            self.peak.fill(0.0);
        }
    }

    /// Way gone so far, metres.
    pub(crate) fn way(&self) -> f64 {
        self.way
    }

    fn variances(&self) -> SVector<f64, 6> {
        let position = (DRIFT_SHARE * self.way).powi(2);
        let rotation = TURN_PER_SQRT_M.powi(2) * self.way;
        self.past + SVector::from([position, position, position, rotation, rotation, rotation])
    }
}

/// What is published beside the filter's state.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quality {
    pub(crate) degeneracy: Degeneracy,
    pub(crate) share: f64,
    pub(crate) tracking: TrackingState,
    /// Gravity is known in the map.
    pub(crate) levelled: bool,
}

/// Pose frame of a running filter.
pub(crate) fn pose_frame(
    frame: &FrameHeader,
    filter: &Filter,
    imu_from_lidar: &Isometry3<f64>,
    drift: &Drift,
    quality: &Quality,
) -> PoseFrame {
    let map_from_imu = filter.map_from_imu();
    let mut pose = PoseFrame {
        frame: *frame,
        velocity: filter.velocity.into(),
        gyro_bias: filter.gyro_bias.into(),
        accel_bias: filter.accel_bias.into(),
        gravity: gravity(quality.levelled),
        covariance: lidar_covariance(filter, imu_from_lidar, drift),
        quality: quality.share as f32,
        degenerate: quality.degeneracy.count as u32,
        state: quality.tracking as u32,
        ..PoseFrame::default()
    };
    let axes = quality.degeneracy.axes.iter().take(quality.degeneracy.count);
    for (to, axis) in pose.degenerate_axes.iter_mut().zip(axes) {
        *to = (*axis).into();
    }
    set_map_from_imu(&mut pose, &map_from_imu);
    set_map_from_lidar(&mut pose, &(map_from_imu * imu_from_lidar));
    pose
}

/// Pose frame before the start: the LiDAR at the map's origin, upright as far as gravity is known.
pub(crate) fn waiting_frame(
    frame: &FrameHeader,
    map_from_imu_rotation: &UnitQuaternion<f64>,
    imu_from_lidar: &Isometry3<f64>,
    levelled: bool,
) -> PoseFrame {
    let mut pose = PoseFrame {
        frame: *frame,
        gravity: gravity(levelled),
        state: TrackingState::Initialising as u32,
        ..PoseFrame::default()
    };
    let rotation = map_from_imu_rotation * imu_from_lidar.rotation;
    let map_from_lidar = Isometry3::from_parts(Vector3::zeros().into(), rotation);
    set_map_from_lidar(&mut pose, &map_from_lidar);
    set_map_from_imu(&mut pose, &(map_from_lidar * imu_from_lidar.inverse()));
    pose
}

fn gravity(levelled: bool) -> [f64; 3] {
    [0.0, 0.0, if levelled { -STANDARD_GRAVITY } else { 0.0 }]
}

/// Covariance of the LiDAR's pose, row-major: with lever arm `t`, `dp_lidar = dp + dphi x R t`.
fn lidar_covariance(filter: &Filter, imu_from_lidar: &Isometry3<f64>, drift: &Drift) -> [f64; 36] {
    let mut jacobian = SMatrix::<f64, 6, 6>::identity();
    let lever: Matrix3<f64> = -skew(&(filter.rotation * imu_from_lidar.translation.vector));
    jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&lever);
    let pose: PoseInformation = filter.covariance.fixed_view::<6, 6>(0, 0).into_owned();
    let lidar = jacobian * pose * jacobian.transpose() * HONESTY.powi(2)
        + SMatrix::from_diagonal(&(drift.variances() * HONESTY.powi(2)));
    let mut row_major = [0.0; 36];
    for (i, value) in row_major.iter_mut().enumerate() {
        *value = (lidar[(i / 6, i % 6)] + lidar[(i % 6, i / 6)]) / 2.0;
    }
    row_major
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_blind_stretch_cost_stays_in_the_covariance_after_it() {
        let mut filter = Filter::new(0, &Isometry3::identity(), 0.0, 0.001);
        let mut drift = Drift::default();
        filter.covariance[(1, 1)] = 0.01;
        drift.count(&filter, 0.0, true);
        filter.covariance[(1, 1)] = 1e-8;
        drift.count(&filter, 0.0, false);
        let covariance = lidar_covariance(&filter, &Isometry3::identity(), &drift);
        assert!(covariance[7].sqrt() >= 0.2 && covariance[0].sqrt() < 0.01);
    }

    #[test]
    fn a_rotation_that_is_not_known_moves_a_lidar_that_sits_beside_the_imu() {
        let filter = Filter::new(0, &Isometry3::identity(), 0.0, 0.01);
        let rig = Isometry3::translation(0.5, 0.0, 0.0);
        let covariance = lidar_covariance(&filter, &rig, &Drift::default());
        assert!((covariance[14].sqrt() - HONESTY * 0.005).abs() < 1e-4);
        assert!(covariance[0].sqrt() < 1e-3);
    }
}

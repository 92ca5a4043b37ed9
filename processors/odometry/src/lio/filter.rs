//! The running filter: its state, what it believes, and how both are loosened, held and fixed in the map frame.

use evac_frames::{FrameHeader, PoseFrame, TrackingState};
use evac_geometry::nalgebra::{Isometry3, Matrix3, SMatrix, Vector3};

use super::cell::PoseVariance;
use super::config::LioConfig;
use super::correction::Report;
use super::degeneracy::Degeneracy;
use super::initialisation::{Start, upright};
use super::monitor::Monitor;
use super::report::{lidar_covariance, pose_frame};
use super::settling::Settling;
use super::state::{Covariance, DIM, State, add_variance, at};

/// What each frame of a loss adds to the uncertainty: rotation (1 degree), velocity (m/s), position (m). The motion is then free
/// to follow the match alone.
const LOST_ROTATION: f64 = 0.0175;
const LOST_VELOCITY: f64 = 0.5;
const LOST_POSITION: f64 = 0.15;
/// Uncertainty of a map that is begun anew after a loss against the one before, m and rad.
const RESTART_POSITION: f32 = 1.0;
const RESTART_ROTATION: f32 = 0.1;
/// Velocity of a rig at rest, m/s (standard deviation).
const REST_VELOCITY: f64 = 0.01;
/// An accelerometer bias beyond this is a false one, m/s^2.
pub(crate) const MAX_ACCEL_BIAS: f64 = 0.5;

/// A running filter; its state holds at `stamp_ns` by the IMU's clock.
#[derive(Debug)]
pub(crate) struct Filter {
    pub(crate) state: State,
    pub(crate) covariance: Covariance,
    pub(crate) stamp_ns: i64,
    /// Mean angular velocity of the last frame, IMU frame, for when the IMU is silent.
    pub(crate) rate: Vector3<f64>,
    pub(crate) monitor: Monitor,
    pub(crate) degeneracy: Degeneracy,
    /// Frames since the start.
    pub(crate) frame: usize,
    pub(crate) settling: Option<Settling>,
    /// Uncertainty that the map in view was laid with.
    pub(crate) inherited: PoseVariance,
}

impl Filter {
    pub(crate) fn new(start: &Start, stamp_ns: i64, config: &LioConfig) -> Self {
        let mut covariance = start.covariance;
        covariance[(at::TIME_OFFSET, at::TIME_OFFSET)] = (config.time_offset_sigma_ms * 1e-3).powi(2);
        add_variance(&mut covariance, at::GYRO_SCALE, config.gyro_scale_sigma.powi(2));
        Self {
            state: start.state,
            covariance,
            stamp_ns,
            rate: Vector3::zeros(),
            monitor: Monitor::default(),
            degeneracy: Degeneracy::default(),
            frame: 0,
            settling: (!start.standing).then_some(Settling::at_start()),
            inherited: PoseVariance::default(),
        }
    }

    /// Whether noise and gates are those of the loose mode.
    pub(crate) fn is_loose(&self) -> bool {
        self.monitor.is_lost() || self.settling.is_some()
    }

    /// Scale of the process noise, frozen at one while a direction rests on the IMU alone: loose velocity there would
    /// cost what the frames before have learnt.
    pub(crate) fn noise_factor(&self) -> f64 {
        if self.degeneracy.count > 0 { 1.0 } else { self.monitor.noise_factor() }
    }

    /// What was believed is believed less.
    pub(crate) fn loosen(&mut self) {
        add_variance(&mut self.covariance, at::POSITION, LOST_POSITION.powi(2));
        add_variance(&mut self.covariance, at::ROTATION, LOST_ROTATION.powi(2));
        add_variance(&mut self.covariance, at::VELOCITY, LOST_VELOCITY.powi(2));
    }

    /// There is no way back to the map: a new one begins, and its place in the old one is poorly known.
    pub(crate) fn restart(&mut self) {
        self.settling = Some(Settling::after_loss());
        for variance in &mut self.inherited.position {
            *variance += RESTART_POSITION * RESTART_POSITION;
        }
        self.inherited.rotation += RESTART_ROTATION * RESTART_ROTATION;
    }

    /// Takes back what no carrier does: too fast a motion since `before`, too large a bias.
    pub(crate) fn hold_speed(&mut self, before: &State, config: &LioConfig) {
        if self.state.velocity.norm() > config.max_speed_m_s {
            self.state.velocity = Vector3::zeros();
            self.state.position = before.position;
            add_variance(&mut self.covariance, at::VELOCITY, 1.0);
        }
        if self.state.accel_bias.norm() > MAX_ACCEL_BIAS {
            self.state.accel_bias = Vector3::zeros();
        }
    }

    /// Zero-velocity update of a rig at rest: before a blank wall nothing else keeps it from gliding along.
    pub(crate) fn rest(&mut self) {
        let columns: SMatrix<f64, DIM, 3> = self.covariance.fixed_columns::<3>(at::VELOCITY).into_owned();
        let innovation = columns.fixed_rows::<3>(at::VELOCITY) + Matrix3::identity() * REST_VELOCITY.powi(2);
        let Some(inverse) = innovation.try_inverse() else { return };
        let gain = columns * inverse;
        self.state = self.state.plus(&(gain * -self.state.velocity));
        self.covariance -= gain * columns.transpose();
        self.covariance = (self.covariance + self.covariance.transpose()) / 2.0;
    }

    /// Fixes the map frame where the LiDAR is now: origin, z against gravity, yaw of the LiDAR zero.
    pub(crate) fn rebase(&mut self, imu_from_lidar: &Isometry3<f64>) {
        let rotation = upright(&(self.state.rotation.inverse() * -self.state.gravity), imu_from_lidar);
        let new_from_old = rotation * self.state.rotation.inverse();
        self.state.rotation = rotation;
        self.state.position = -(rotation * imu_from_lidar.translation.vector);
        self.state.velocity = new_from_old * self.state.velocity;
        self.state.gravity = new_from_old * self.state.gravity;
        let mut turn = Covariance::identity();
        for index in [at::VELOCITY, at::GRAVITY] {
            let mut block = turn.fixed_view_mut::<3, 3>(index, index);
            block.copy_from(new_from_old.to_rotation_matrix().matrix());
        }
        // The pose is exact by definition now.
        for index in at::ROTATION..at::TIME_OFFSET {
            turn[(index, index)] = 0.0;
        }
        self.covariance = turn * self.covariance * turn.transpose();
        add_variance(&mut self.covariance, at::ROTATION, 1e-10);
        add_variance(&mut self.covariance, at::POSITION, 1e-10);
    }

    /// Uncertainty that cells get which are first seen from here.
    pub(crate) fn viewpoint(&self, imu_from_lidar: &Isometry3<f64>) -> PoseVariance {
        let covariance = lidar_covariance(&self.state, &self.covariance, imu_from_lidar, &self.inherited);
        let variance = |i: usize| covariance[7 * i] as f32;
        PoseVariance {
            position: [variance(0), variance(1), variance(2)],
            rotation: variance(3).max(variance(4)).max(variance(5)),
        }
    }

    pub(crate) fn is_finite(&self) -> bool {
        self.state.is_finite() && self.covariance.iter().all(|x| x.is_finite())
    }

    pub(crate) fn published(
        &self,
        frame: &FrameHeader,
        imu_from_lidar: &Isometry3<f64>,
        report: &Report,
        tracking: TrackingState,
    ) -> PoseFrame {
        let covariance = lidar_covariance(&self.state, &self.covariance, imu_from_lidar, &self.inherited);
        let quality = report.used as f64 / report.selected.max(1) as f64;
        pose_frame(frame, &self.state, covariance, imu_from_lidar, &self.degeneracy, quality, tracking)
    }
}

//! A standby: its filter and map are kept where the routed odometry is, so that it goes on from there in the same map frame.
//!
//! For [`WARM_FRAMES`] it lays scans at the routed poses. From then on it tracks each scan itself, is compared with the routed pose
//! and takes that over; it is ready while both agree.

use evac_frames::{PoseFrame, TrackingState, scan_flags};
use evac_geometry::nalgebra::{UnitQuaternion, Vector3};
use evac_geometry::{STANDARD_GRAVITY, log_so3, map_from_imu};
use evac_stage::{Counters, Readiness, ScanWithImu};

use super::filter::Filter;
use super::initialisation::Start;
use super::sections::Sections;
use super::stage::{Lio, insert_all};
use super::state::{Covariance, State, add_variance, at};

/// Frames whose scans are laid at the routed poses before the first match: 2 s of the walk.
const WARM_FRAMES: u32 = 20;
/// Frames in a row that must agree with the routed pose, and how far, metres and radians.
const AGREEING_FRAMES: u32 = 5;
const AGREEING_M: f64 = 0.01;
const AGREEING_RAD: f64 = 0.002;
/// What a routed pose is taken to be off by against the map laid from its like (standard deviations): rotation, position, velocity,
/// biases, gravity.
const ROTATION: f64 = 1e-3;
const POSITION: f64 = 5e-3;
const VELOCITY: f64 = 0.05;
const GYRO_BIAS: f64 = 1e-3;
const ACCEL_BIAS: f64 = 0.02;
const GRAVITY: f64 = 0.02;
/// Least uncertainty of the routed time offset, seconds.
const TIME_OFFSET: f64 = 1e-3;

/// How far a standby is.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Following {
    frames: u32,
    agreeing: u32,
}

impl Lio {
    pub(crate) fn follow_pose(&mut self, input: &ScanWithImu<'_>, routed: Option<&PoseFrame>) -> Readiness {
        let Some(routed) = routed.filter(|pose| is_usable(pose)) else {
            // The routed odometry waits for its start, or is lost: so is this one.
            self.pose_of(input, &mut Counters::default());
            self.following = Following::default();
            return Readiness::Following;
        };
        if self.following.frames < WARM_FRAMES {
            self.following.agreeing = 0;
            self.lay(input, routed);
        } else {
            self.pose_of(input, &mut Counters::default());
            let agrees = self.filter.as_ref().is_some_and(|filter| agree(&filter.state, routed));
            self.following.agreeing = if agrees { self.following.agreeing + 1 } else { 0 };
            self.take_over_state(routed);
        }
        self.following.frames = self.following.frames.saturating_add(1);
        if self.following.agreeing < AGREEING_FRAMES { Readiness::Following } else { Readiness::Ready }
    }

    /// Lays the scan at the routed pose.
    fn lay(&mut self, input: &ScanWithImu<'_>, routed: &PoseFrame) {
        let is_new = self.following.frames == 0;
        let Some((gap_s, _)) = self.advance(input) else { return };
        if is_new {
            self.map.clear();
            self.begin_at(input);
        }
        let Some(mut filter) = self.filter.take() else { return };
        let before = filter.state;
        if !is_new {
            self.predict(&mut filter, input);
        }
        let is_deskewed = input.header.scan_flags & scan_flags::DESKEWED != 0;
        self.take_points(&filter.state, filter.frame, input);
        filter.covariance = covariance(routed, &filter);
        filter.rate = log_so3(&(before.rotation.inverse() * rotation(routed))) / gap_s.max(1e-3);
        self.filter = Some(filter);
        self.take_over_state(routed);
        if let Some(filter) = &self.filter
            && (is_deskewed || !is_new)
        {
            self.map.next_frame(filter.sections.current());
            let map_from_lidar = filter.state.map_from_imu() * self.imu_from_lidar;
            insert_all(&mut self.map, &map_from_lidar, self.points.iter().copied());
        }
    }

    /// A filter at the routed pose, whatever there was before.
    fn begin_at(&mut self, input: &ScanWithImu<'_>) {
        let mut sections = match self.filter.take() {
            Some(filter) => filter.sections,
            None => self.sections.take().unwrap_or_else(Sections::new),
        };
        sections.clear();
        let start = Start {
            state: State::at_origin(),
            covariance: Covariance::zeros(),
            accel_noise: 0.0,
            gyro_noise: 0.0,
            standing: true,
        };
        let mut filter = Filter::new(&start, input.header.frame.end_ns, &self.config, sections);
        filter.settle_offset();
        self.filter = Some(filter);
    }

    /// Takes over pose, velocity, biases, gravity and time offset.
    fn take_over_state(&mut self, routed: &PoseFrame) {
        let Some(filter) = &mut self.filter else { return };
        let state = &mut filter.state;
        state.rotation = rotation(routed);
        state.position = routed.imu_position.into();
        state.velocity = routed.velocity.into();
        state.gyro_bias = routed.gyro_bias.into();
        state.accel_bias = routed.accel_bias.into();
        let gravity = Vector3::from(routed.gravity);
        state.gravity = gravity * (STANDARD_GRAVITY / gravity.norm());
        state.time_offset_s = routed.time_offset_ns as f64 * 1e-9;
        filter.stamp_ns = routed.frame.end_ns - filter.state.offset_ns();
    }
}

fn rotation(routed: &PoseFrame) -> UnitQuaternion<f64> {
    map_from_imu(routed).rotation
}

/// Whether the routed pose says where the rig is, and all its numbers can be true.
fn is_usable(pose: &PoseFrame) -> bool {
    let tracks = matches!(pose.tracking_state(), Some(TrackingState::Tracking | TrackingState::Degenerate));
    let numbers = [pose.imu_position, pose.velocity, pose.gyro_bias, pose.accel_bias, pose.gravity];
    let turned = pose.imu_orientation.iter().map(|q| q * q).sum::<f64>();
    tracks
        && numbers.iter().flatten().all(|value| value.is_finite())
        && (turned - 1.0).abs() < 1e-3
        && (Vector3::from(pose.gravity).norm() - STANDARD_GRAVITY).abs() < 1.0
}

fn agree(state: &State, routed: &PoseFrame) -> bool {
    let way = (state.position - Vector3::from(routed.imu_position)).norm();
    let turn = state.rotation.angle_to(&rotation(routed));
    way < AGREEING_M && turn < AGREEING_RAD
}

fn covariance(routed: &PoseFrame, filter: &Filter) -> Covariance {
    let mut covariance = filter.at_start_covariance();
    for (index, sigma) in [
        (at::ROTATION, ROTATION),
        (at::POSITION, POSITION),
        (at::VELOCITY, VELOCITY),
        (at::GYRO_BIAS, GYRO_BIAS),
        (at::ACCEL_BIAS, ACCEL_BIAS),
        (at::GRAVITY, GRAVITY),
    ] {
        add_variance(&mut covariance, index, sigma.powi(2));
    }
    let offset = (f64::from(routed.time_offset_sigma_us) * 1e-6).max(TIME_OFFSET);
    covariance[(at::TIME_OFFSET, at::TIME_OFFSET)] = offset.powi(2);
    covariance
}

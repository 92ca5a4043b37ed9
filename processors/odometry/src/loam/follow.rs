//! A standby: its filter and maps are kept where the routed odometry is, so that it goes on from there in the same map frame.
//!
//! For [`WARM_FRAMES`] it lays scans at the routed poses. From then on it tracks each scan itself, is compared with the routed pose
//! and takes that over; it is ready while both agree.

use evac_frames::{PoseFrame, TrackingState};
use evac_geometry::nalgebra::Vector3;
use evac_geometry::{log_so3, map_from_imu};
use evac_stage::{Counters, Readiness, ScanWithImu};

use super::filter::Filter;
use super::monitor::Monitor;
use super::stage::Loam;
use super::tracking::sweep;

/// Frames whose scans are laid at the routed poses before the first match: 3 s of the walk, as features are few.
const WARM_FRAMES: u32 = 30;
/// Frames in a row that must agree with the routed pose, and how far, metres and radians.
const AGREEING_FRAMES: u32 = 3;
const AGREEING_M: f64 = 0.02;
const AGREEING_RAD: f64 = 0.0035;
/// Standard deviations of a followed state: velocity, m/s, and tilt, rad.
const SPEED: f64 = 0.1;
const TILT: f64 = 2e-3;

/// How far a standby is.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Following {
    frames: u32,
    agreeing: u32,
}

impl Loam {
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
            let agrees = self.filter.is_some_and(|filter| agree(&filter, routed));
            self.following.agreeing = if agrees { self.following.agreeing + 1 } else { 0 };
            if let Some(filter) = &mut self.filter {
                take_over_state(filter, routed);
            }
        }
        self.following.frames = self.following.frames.saturating_add(1);
        if self.following.agreeing < AGREEING_FRAMES { Readiness::Following } else { Readiness::Ready }
    }

    /// Lays the scan at the routed pose.
    fn lay(&mut self, input: &ScanWithImu<'_>, routed: &PoseFrame) {
        let Some(span) = self.advance(input, &mut Counters::default()) else { return };
        let end = map_from_imu(routed);
        let mut filter = Filter::new(input.header.frame.end_ns, &end, SPEED, TILT);
        let before = match self.filter.filter(|_| self.following.frames > 0) {
            Some(before) => {
                filter.rate = log_so3(&(before.rotation.inverse() * end.rotation)) / span.h.max(1e-3);
                before
            }
            None => {
                self.clear_map();
                self.settling = None;
                self.monitor = Monitor::default();
                self.levelled = true;
                Filter { stamp_ns: input.header.frame.start_ns, ..filter }
            }
        };
        take_over_state(&mut filter, routed);
        let step = (filter.position - before.position).norm();
        self.drift.count(&filter, step, false);
        self.map_scan(&filter, &sweep(input, &before));
        self.filter = Some(filter);
    }
}

fn take_over_state(filter: &mut Filter, routed: &PoseFrame) {
    let end = map_from_imu(routed);
    (filter.position, filter.rotation) = (end.translation.vector, end.rotation);
    filter.velocity = routed.velocity.into();
    filter.gyro_bias = routed.gyro_bias.into();
    filter.accel_bias = routed.accel_bias.into();
}

/// Whether the routed pose says where the rig is, and all its numbers can be true.
fn is_usable(pose: &PoseFrame) -> bool {
    let tracks = matches!(pose.tracking_state(), Some(TrackingState::Tracking | TrackingState::Degenerate));
    let numbers = [pose.imu_position, pose.velocity, pose.gyro_bias, pose.accel_bias];
    let turned = pose.imu_orientation.iter().map(|q| q * q).sum::<f64>();
    tracks && numbers.iter().flatten().all(|value| value.is_finite()) && (turned - 1.0).abs() < 1e-3
}

fn agree(filter: &Filter, routed: &PoseFrame) -> bool {
    let way = (filter.position - Vector3::from(routed.imu_position)).norm();
    let turn = filter.rotation.angle_to(&map_from_imu(routed).rotation);
    way < AGREEING_M && turn < AGREEING_RAD
}

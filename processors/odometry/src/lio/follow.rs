//! As a standby; see [`crate::follow`].

use evac_frames::{PoseFrame, scan_flags};
use evac_geometry::nalgebra::{Isometry3, Vector3};
use evac_geometry::{STANDARD_GRAVITY, log_so3, map_from_imu};
use evac_stage::{Counters, ScanWithImu};

use super::filter::Filter;
use super::initialisation::Start;
use super::sections::{ORIGIN, Sections};
use super::stage::{Lio, insert_all};
use super::state::{Covariance, State, add_gravity_variance, add_variance, at};
use crate::follow::{Following, Standby};

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

impl Standby for Lio {
    /// 2 s of the walk.
    const WARM_FRAMES: u32 = 20;
    const AGREEING: (f64, f64) = (0.02, 0.0035);

    fn following(&mut self) -> &mut Following {
        &mut self.following
    }

    fn track(&mut self, input: &ScanWithImu<'_>, counters: &mut Counters) -> PoseFrame {
        self.pose_of(input, counters)
    }

    fn lay(&mut self, input: &ScanWithImu<'_>, routed: &PoseFrame, is_first: bool) {
        let Some((gap_s, _)) = self.advance(input) else { return };
        if is_first {
            self.map.clear();
            self.begin_at(input);
        }
        let Some(mut filter) = self.filter.take() else { return };
        let before = filter.state;
        if !is_first {
            self.predict(&mut filter, input);
        }
        let is_deskewed = input.header.scan_flags & scan_flags::DESKEWED != 0;
        self.take_points(&filter.state, filter.frame, input);
        filter.covariance = covariance(routed, &filter);
        let turn = log_so3(&(before.rotation.inverse() * map_from_imu(routed).rotation));
        filter.habit.take(gap_s, &routed.velocity.into(), &(turn / gap_s.max(1e-3)));
        self.filter = Some(filter);
        self.take_over(routed);
        if let Some(filter) = &self.filter
            && (is_deskewed || !is_first)
        {
            self.map.next_frame(filter.sections.current(), filter.sections.drift.current());
            let map_from_lidar = filter.state.map_from_imu() * self.imu_from_lidar;
            insert_all(
                &mut self.map,
                &map_from_lidar,
                self.points.iter().copied(),
                filter.sections.to_frames(&filter.state),
            );
        }
    }

    fn pose(&self) -> Option<Isometry3<f64>> {
        self.filter.as_ref().map(Filter::origin_from_imu)
    }

    fn take_over(&mut self, routed: &PoseFrame) {
        self.approach.restart();
        // The way so far is another's.
        self.forget_start();
        let Some(filter) = &mut self.filter else { return };
        let current_from_origin = filter.sections.place(ORIGIN, &filter.state);
        let state = &mut filter.state;
        state.rotation = map_from_imu(routed).rotation;
        state.position = routed.imu_position.into();
        state.velocity = routed.velocity.into();
        state.gyro_bias = routed.gyro_bias.into();
        state.accel_bias = routed.accel_bias.into();
        // An odometry without IMU knows of none.
        let gravity = Vector3::from(routed.gravity);
        if (gravity.norm() - STANDARD_GRAVITY).abs() < 1.0 {
            state.gravity = gravity * (STANDARD_GRAVITY / gravity.norm());
        }
        state.time_offset_s = routed.time_offset_ns as f64 * 1e-9;
        *state = state.moved(&current_from_origin);
        filter.stamp_ns = routed.frame.end_ns - filter.state.offset_ns();
    }
}

impl Lio {
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
}

fn covariance(routed: &PoseFrame, filter: &Filter) -> Covariance {
    let mut covariance = filter.at_start_covariance();
    for (index, sigma) in [
        (at::ROTATION, ROTATION),
        (at::POSITION, POSITION),
        (at::VELOCITY, VELOCITY),
        (at::GYRO_BIAS, GYRO_BIAS),
        (at::ACCEL_BIAS, ACCEL_BIAS),
    ] {
        add_variance(&mut covariance, index, sigma.powi(2));
    }
    add_gravity_variance(&mut covariance, &filter.state.gravity, GRAVITY.powi(2));
    let offset = (f64::from(routed.time_offset_sigma_us) * 1e-6).max(TIME_OFFSET);
    covariance[(at::TIME_OFFSET, at::TIME_OFFSET)] = offset.powi(2);
    covariance
}

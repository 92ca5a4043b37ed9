//! The running filter: its state, what it believes, and how both are loosened, held and fixed in the map frame.

use evac_frames::{FrameHeader, PoseFrame, TrackingState};
use evac_geometry::nalgebra::{Isometry3, Matrix3, SMatrix, SVector, Vector3};
use evac_geometry::skew;

use super::config::LioConfig;
use super::correction::Report;
use super::degeneracy::Degeneracy;
use super::habit::Habit;
use super::initialisation::{Start, upright};
use super::monitor::Monitor;
use super::offset::PoseCovariance;
use super::report::{lidar_covariance, pose_frame, sigma_us, waiting_frame};
use super::sections::Sections;
use super::settling::Settling;
use super::state::{Covariance, DIM, MOVING, State, add_variance, at, copy_places, largest_sigma};

/// What each frame of a loss adds to the uncertainty: rotation (1 degree), velocity (m/s), position (m). The motion is then free
/// to follow the match alone.
const LOST_ROTATION: f64 = 0.0175;
const LOST_VELOCITY: f64 = 0.5;
const LOST_POSITION: f64 = 0.15;
/// ... up to so many times as much.
const LOST_LIMIT: f64 = 3.0;
/// Velocity of whoever carries the rig, m/s (standard deviation).
const CARRIED_VELOCITY: f64 = 1.0;
/// A velocity less certain than this is held to that one, m/s.
const UNCERTAIN_VELOCITY: f64 = 0.5;
/// Random walk of the time offset, s per sqrt(s): for ever, at the start, and how long that lasts.
const OFFSET_WALK: f64 = 1e-4;
const OFFSET_WALK_AT_START: f64 = 3e-3;
const OFFSET_SETTLES_S: f64 = 10.0;
/// Uncertainty of a map that is begun anew after a loss against the one before, m and rad.
const RESTART_POSITION: f64 = 1.0;
const RESTART_ROTATION: f64 = 0.1;
/// Velocity of a rig at rest, m/s (standard deviation).
const REST_VELOCITY: f64 = 0.01;
/// As above for a rig that is slow: at least so much, and so many times the speed that it seems to have. Chosen among 1, 2
/// and 3 on series 6 and 7 (docs/odometry.md).
const SLOW_VELOCITY: f64 = 0.03;
const SLOW_SIGMAS: f64 = 2.0;
/// A velocity that is known to this shows whether a rig is slow, m/s (standard deviation).
const KNOWN_VELOCITY: f64 = 0.1;
/// Blur of a map that is begun in motion, rad and m.
const MOVING_ROTATION: f64 = 1e-3;
const MOVING_POSITION: f64 = 5e-3;
/// Error of its velocity beyond what the scans show, m/s.
const SETTLED_VELOCITY: f64 = 0.1;
/// Uncertainty of a time offset that the coarse search found, seconds.
const FOUND_TIME_OFFSET: f64 = 0.004;
/// An accelerometer bias beyond this is a false one, m/s^2.
pub(crate) const MAX_ACCEL_BIAS: f64 = 0.5;

/// A running filter; its state holds at `stamp_ns` by the IMU's clock.
#[derive(Debug)]
pub(crate) struct Filter {
    pub(crate) state: State,
    pub(crate) covariance: Covariance,
    pub(crate) stamp_ns: i64,
    started_ns: i64,
    /// What was known at the start.
    at_start: (State, Covariance),
    /// How the rig is carried, for when the IMU is silent.
    pub(crate) habit: Habit,
    /// Way since the frame before by the IMU alone, map frame, metres.
    pub(crate) carried: Vector3<f64>,
    pub(crate) monitor: Monitor,
    pub(crate) degeneracy: Degeneracy,
    /// Of these, if any are, the directions that the shape of the surroundings leaves open; the others are open because the place of
    /// what is seen is not known.
    pub(crate) open: Degeneracy,
    /// Frames since the start.
    pub(crate) frame: usize,
    pub(crate) settling: Option<Settling>,
    /// Frames in which the pose still comes back to an older section of the map: a step then is no surprise.
    pub(crate) returning: u32,
    /// Good scans that were not mapped because the clocks' offset was not known.
    pub(crate) withheld: u32,
    /// Parts of the map and how they lie to the one that the covariance is relative to.
    pub(crate) sections: Sections,
}

impl Filter {
    pub(crate) fn new(start: &Start, end_ns: i64, config: &LioConfig, sections: Sections) -> Self {
        let mut covariance = start.covariance;
        covariance[(at::TIME_OFFSET, at::TIME_OFFSET)] = (config.time_offset_sigma_ms * 1e-3).powi(2);
        add_variance(&mut covariance, at::GYRO_SCALE, config.gyro_scale_sigma.powi(2));
        add_misalignment(&mut covariance, &start.state, config.misalignment_sigma_deg.to_radians());
        let mut state = start.state;
        state.gyro_scale = config.gyro_scale.into();
        state.time_offset_s = config.time_offset_ms * 1e-3;
        Self {
            state,
            at_start: (state, covariance),
            covariance,
            stamp_ns: end_ns - state.offset_ns(),
            started_ns: end_ns - state.offset_ns(),
            habit: Habit::default(),
            carried: Vector3::zeros(),
            monitor: Monitor::default(),
            degeneracy: Degeneracy::default(),
            open: Degeneracy::default(),
            frame: 0,
            settling: (!start.standing).then_some(Settling::at_start()),
            returning: 0,
            // Without a standstill there is no map that is better than what comes.
            withheld: if start.standing { 0 } else { u32::MAX },
            sections,
        }
    }

    /// What nothing has been learnt of: the covariance at the start.
    pub(crate) fn at_start_covariance(&self) -> Covariance {
        self.at_start.1
    }

    /// Takes the time offset for one that has settled long ago, and does not wait for its search to map.
    pub(crate) fn settle_offset(&mut self) {
        self.started_ns -= (10.0 * OFFSET_SETTLES_S * 1e9) as i64;
        self.withheld = u32::MAX;
    }

    /// Takes what a match, or none, says about the directions that are not observed.
    pub(crate) fn observe(&mut self, report: &Report) {
        self.degeneracy = Degeneracy::of(&report.position_information);
        self.open = Degeneracy::of(&report.seen_information);
    }

    /// Whether the map frame is not fixed yet.
    pub(crate) fn is_starting(&self) -> bool {
        self.settling.is_some_and(|settling| settling.starting)
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
        for (index, sigma) in
            [(at::POSITION, LOST_POSITION), (at::ROTATION, LOST_ROTATION), (at::VELOCITY, LOST_VELOCITY)]
        {
            for i in index..index + 3 {
                let room = (LOST_LIMIT * sigma).powi(2) - self.covariance[(i, i)];
                self.covariance[(i, i)] += sigma.powi(2).min(room.max(0.0));
            }
        }
        // What nothing observes must not run away meanwhile.
        self.expect_velocity(CARRIED_VELOCITY);
    }

    /// There is no way back to the map: a new one begins, and its place in the old one is poorly known.
    pub(crate) fn restart(&mut self) {
        self.settling = Some(Settling::after_loss());
        let mut pose = PoseCovariance::identity() * RESTART_POSITION.powi(2);
        pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Matrix3::identity() * RESTART_ROTATION.powi(2)));
        self.sections.doubt(&mut self.state, &mut self.covariance, &pose);
    }

    /// Begins at a frame's end with an offset between the clocks that is known already.
    pub(crate) fn begin_with_offset(&mut self, offset_s: f64, end_ns: i64) {
        self.put_offset(offset_s, end_ns);
        self.started_ns = self.stamp_ns;
    }

    /// Takes an offset between the clocks that was found elsewhere, at a frame's end. All but the pose was learnt with the wrong one.
    pub(crate) fn correct_offset(&mut self, offset_s: f64, end_ns: i64) {
        self.forget();
        self.put_offset(offset_s, end_ns);
        add_variance(&mut self.covariance, at::VELOCITY, CARRIED_VELOCITY.powi(2));
        self.loosen();
    }

    fn put_offset(&mut self, offset_s: f64, end_ns: i64) {
        self.state.time_offset_s = offset_s;
        self.covariance[(at::TIME_OFFSET, at::TIME_OFFSET)] = FOUND_TIME_OFFSET.powi(2);
        self.stamp_ns = end_ns - self.state.offset_ns();
    }

    /// Goes back to what was known of sensors and gravity at the start; pose and velocity stay, but nothing is known of how good
    /// they are.
    fn forget(&mut self) {
        let State { rotation, position, velocity, places, .. } = self.state;
        let (state, covariance) = self.at_start;
        self.state = State { rotation, position, velocity, places, ..state };
        let before = self.covariance;
        self.covariance = covariance;
        copy_places(&before, &mut self.covariance);
        for index in (0..MOVING).filter(|index| *index != at::TIME_OFFSET) {
            self.covariance.row_mut(index).fill(0.0);
            self.covariance.column_mut(index).fill(0.0);
        }
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

    /// Random walk of the time offset, s per sqrt(s): clocks hardly drift, but while the first motions are still badly modelled the
    /// filter becomes too sure of a wrong one. While a direction rests on the IMU the offset does not show.
    pub(crate) fn offset_walk(&self) -> f64 {
        let seconds = (self.stamp_ns - self.started_ns) as f64 * 1e-9;
        let at_start = OFFSET_WALK_AT_START * (-seconds / OFFSET_SETTLES_S).exp();
        if self.degeneracy.count > 0 { 0.0 } else { OFFSET_WALK + at_start }
    }

    /// Whoever carries the rig walks: says so where the velocity has become uncertain, which also levels a pose that lost its tilt.
    pub(crate) fn hold_velocity(&mut self) {
        if self.velocity_sigma() > UNCERTAIN_VELOCITY {
            self.expect_velocity(CARRIED_VELOCITY);
        }
    }

    /// Largest standard deviation of the velocity, m/s.
    pub(crate) fn velocity_sigma(&self) -> f64 {
        largest_sigma(&self.covariance, at::VELOCITY)
    }

    /// Largest standard deviation of the rotation, rad.
    pub(crate) fn rotation_sigma(&self) -> f64 {
        largest_sigma(&self.covariance, at::ROTATION)
    }

    /// Zero-velocity update of a rig at rest: before a blank wall nothing else keeps it from gliding along.
    pub(crate) fn rest(&mut self) {
        self.expect_velocity(REST_VELOCITY);
    }

    /// Whoever is carried as slowly as this turns on the spot, is about to stand or has just stood: the velocity is zero, give or take
    /// what it seems to be. Next to nothing for a velocity that is seen; before a blank wall, where corners are taken, it says what
    /// nothing else does. A velocity that is not known may seem slow by accident.
    pub(crate) fn slow_down(&mut self) {
        if self.velocity_sigma() < KNOWN_VELOCITY {
            self.expect_velocity((SLOW_SIGMAS * self.state.velocity.norm()).max(SLOW_VELOCITY));
        }
    }

    /// Takes the velocity along gravity for `faster` than what is known to be its mean, give or take `sigma` m/s.
    pub(crate) fn expect_climb(&mut self, faster: f64, sigma: f64) {
        let up = -self.state.gravity / self.state.gravity.norm();
        let column: SVector<f64, DIM> = self.covariance.fixed_columns::<3>(at::VELOCITY) * up;
        let innovation = column.fixed_rows::<3>(at::VELOCITY).dot(&up) + sigma.powi(2);
        self.state = self.state.plus(&(column * (-faster / innovation)));
        self.covariance -= column * column.transpose() / innovation;
        self.covariance = (self.covariance + self.covariance.transpose()) / 2.0;
    }

    /// Takes the velocity for zero, give or take `sigma` m/s.
    fn expect_velocity(&mut self, sigma: f64) {
        let columns: SMatrix<f64, DIM, 3> = self.covariance.fixed_columns::<3>(at::VELOCITY).into_owned();
        let innovation = columns.fixed_rows::<3>(at::VELOCITY) + Matrix3::identity() * sigma.powi(2);
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
        self.sections.clear();
        copy_places(&Covariance::zeros(), &mut self.covariance);
        let velocity = self.covariance.fixed_view::<3, 3>(at::VELOCITY, at::VELOCITY).into_owned();
        let gravity = self.state.gravity;
        self.forget();
        self.state.gravity = gravity;
        self.covariance.fixed_view_mut::<3, 3>(at::VELOCITY, at::VELOCITY).copy_from(&velocity);
        add_variance(&mut self.covariance, at::VELOCITY, SETTLED_VELOCITY.powi(2));
        // The pose is exact by definition now, up to the blur of the scans that the map begins with.
        for index in at::ROTATION..at::TIME_OFFSET {
            turn[(index, index)] = 0.0;
        }
        self.covariance = turn * self.covariance * turn.transpose();
        add_variance(&mut self.covariance, at::ROTATION, MOVING_ROTATION.powi(2));
        add_variance(&mut self.covariance, at::POSITION, MOVING_POSITION.powi(2));
    }

    /// Pose of the IMU relative to the map's origin.
    pub(crate) fn origin_from_imu(&self) -> Isometry3<f64> {
        self.sections.seen_from_origin(&self.state).map_from_imu()
    }

    pub(crate) fn is_finite(&self) -> bool {
        self.state.is_finite() && self.covariance.iter().all(|x| x.is_finite())
    }

    /// Pose of a filter whose map frame is not fixed yet: where it is in a level frame is not said, but how it moves, so that the next
    /// scan is deskewed with it.
    pub(crate) fn settling_pose(
        &self,
        frame: &FrameHeader,
        imu_from_lidar: &Isometry3<f64>,
        report: &Report,
    ) -> PoseFrame {
        let rotation = upright(&(self.state.rotation.inverse() * -self.state.gravity), imu_from_lidar);
        let level_from_map = rotation * self.state.rotation.inverse();
        PoseFrame {
            velocity: (level_from_map * self.state.velocity).into(),
            gyro_bias: self.state.gyro_bias.into(),
            accel_bias: self.state.accel_bias.into(),
            time_offset_ns: self.state.offset_ns(),
            quality: report.quality() as f32,
            ..waiting_frame(frame, &rotation, imu_from_lidar)
        }
    }

    pub(crate) fn published(
        &self,
        frame: &FrameHeader,
        imu_from_lidar: &Isometry3<f64>,
        report: &Report,
        tracking: TrackingState,
    ) -> PoseFrame {
        let pose = self.sections.origin_covariance(&self.state, &self.covariance);
        let state = self.sections.seen_from_origin(&self.state);
        let covariance = lidar_covariance(&state, &pose, imu_from_lidar);
        let quality = report.quality();
        let degeneracy = if self.open.count > 0 { &self.open } else { &self.degeneracy };
        let mut pose = pose_frame(frame, &state, covariance, imu_from_lidar, degeneracy, quality, tracking);
        pose.time_offset_sigma_us = sigma_us(self.covariance[(at::TIME_OFFSET, at::TIME_OFFSET)]);
        pose
    }
}

/// Largest standard deviation of the position within the present section, metres.
pub(crate) fn position_sigma(covariance: &Covariance) -> f64 {
    largest_sigma(covariance, at::POSITION)
}

/// A misaligned IMU sees gravity where it is not: in the map both are off together, by `g = -R M f` with `M = Exp(m)`.
fn add_misalignment(covariance: &mut Covariance, state: &State, sigma: f64) {
    let force = -(state.rotation.inverse() * state.gravity);
    let gravity_by_misalignment = state.rotation.to_rotation_matrix().matrix() * skew(&force);
    let cross = gravity_by_misalignment * sigma.powi(2);
    let mut add = |row: usize, column: usize, block: &Matrix3<f64>| {
        let mut view = covariance.fixed_view_mut::<3, 3>(row, column);
        view += block;
    };
    add(at::GRAVITY, at::GRAVITY, &(cross * gravity_by_misalignment.transpose()));
    add(at::GRAVITY, at::MISALIGNMENT, &cross);
    add(at::MISALIGNMENT, at::GRAVITY, &cross.transpose());
    add(at::MISALIGNMENT, at::MISALIGNMENT, &(Matrix3::identity() * sigma.powi(2)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_climbed_too_fast_for_two_seconds_comes_down_again_and_goes_on_ahead() {
        let start = Start {
            state: State { velocity: Vector3::new(1.2, 0.0, 0.5), ..State::at_origin() },
            covariance: Covariance::zeros(),
            accel_noise: 0.0,
            gyro_noise: 0.0,
            standing: true,
        };
        let mut filter = Filter::new(&start, 0, &LioConfig::default(), Sections::new());
        let (variance, seconds) = (0.3_f64.powi(2), 2.0);
        add_variance(&mut filter.covariance, at::VELOCITY, variance);
        add_variance(&mut filter.covariance, at::POSITION, variance * seconds * seconds);
        for axis in 0..3 {
            filter.covariance[(at::VELOCITY + axis, at::POSITION + axis)] = variance * seconds;
            filter.covariance[(at::POSITION + axis, at::VELOCITY + axis)] = variance * seconds;
        }
        filter.expect_climb(0.5, 0.1);
        let state = &filter.state;
        assert!((state.velocity - Vector3::new(1.2, 0.0, 0.05)).norm() < 0.01, "{}", state.velocity);
        assert!((state.position - Vector3::new(0.0, 0.0, -0.9)).norm() < 0.01, "{}", state.position);
        assert!(filter.covariance[(at::VELOCITY + 2, at::VELOCITY + 2)].sqrt() < 0.1);
    }
}

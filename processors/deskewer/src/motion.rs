//! The rig's motion over a frame: which state it starts from, and the IMU data that carry it on.

use evac_frames::{FrameHeader, ImuSample, PoseFrame, TrackingState};
use evac_geometry::nalgebra::{UnitQuaternion, Vector3, Vector4};
use evac_geometry::{
    ImuConditioner, ImuCoverage, ImuIntegrator, ImuState, STANDARD_GRAVITY, StandstillDetector, map_from_imu,
};
use evac_stage::ScanWithImu;

use crate::DeskewerConfig;

/// Follows the rig from frame to frame.
///
/// A frame starts from the odometry's latest pose, carried on to the frame by the IMU. Where there is none, from the
/// own state: orientation by the gyroscope alone, with the bias of the last standstill; gravity from the
/// last standstill, slowly drawn to the mean of the specific force; velocity by integration, zero
/// while the rig rests and otherwise forgotten with `velocity_decay_s`, as nothing else bounds its error. A start is then
/// seen right; a steady walk is taken for rest after a second, and a stop out of it for a walk backwards for another.
/// The rotation, which moves far points most, is right throughout.
#[derive(Debug)]
pub(crate) struct Motion {
    config: DeskewerConfig,
    integrator: ImuIntegrator,
    conditioner: ImuConditioner,
    detector: StandstillDetector,
    /// IMU samples since the oldest pose that may still come, in order of time.
    history: Vec<ImuSample>,
    /// At the end of the last frame that was followed.
    state: Option<ImuState>,
    last_end_ns: Option<i64>,
}

/// Samples kept: 2 s at 1000 Hz.
const HISTORY: usize = 2048;
/// So many exact zeros in a row are the firmware's and no chance of quantisation.
const HELD_RUN: usize = 10;
/// How much a pose may be younger than the frame's start: rounding of frame borders.
const OVERLAP_NS: i64 = 5_000_000;
/// A sensor clock that goes back by more has been started anew.
const CLOCK_RESTART_NS: i64 = 1_000_000_000;
/// Time constant with which gravity follows the mean specific force while no pose corrects it, seconds: long against a
/// step, short against the tilt that a gyroscope bias makes (3 degrees in it at 0.3 deg/s).
const LEVELLING_S: f64 = 10.0;
/// No integrated velocity beyond this is believed, m/s: a runner's.
const MAX_OWN_SPEED: f64 = 4.0;
/// A frame is 100 ms; one this long is a broken header.
const LONGEST_FRAME_NS: i64 = 10_000_000_000;
/// Share of its points that an odometry must use before its velocity is believed that has not begun to track.
const SETTLING_QUALITY: f64 = 0.5;
/// Largest believable offset between the clocks of IMU and LiDAR.
const MAX_OFFSET_NS: i64 = evac_frames::MAX_TIME_OFFSET_NS;

impl Motion {
    pub(crate) fn new(config: DeskewerConfig) -> Self {
        Self {
            config,
            integrator: ImuIntegrator::new(HISTORY),
            conditioner: ImuConditioner::default(),
            detector: StandstillDetector::default(),
            history: Vec::with_capacity(HISTORY),
            state: None,
            last_end_ns: None,
        }
    }

    /// The motion over the frame, in a world that may differ from frame to frame (only relative poses count);
    /// `None` where the IMU does not cover it.
    pub(crate) fn follow(&mut self, input: &ScanWithImu<'_>) -> Option<&ImuIntegrator> {
        let frame = &input.header.frame;
        if !is_sound(frame) {
            return None;
        }
        if self.last_end_ns.is_some_and(|last| frame.end_ns < last.saturating_sub(CLOCK_RESTART_NS)) {
            self.restart();
        }
        self.last_end_ns = Some(frame.end_ns);
        self.take_samples(input.imu, frame);
        if !input.imu_covers {
            return None;
        }
        let prior = input.prior.filter(|_| self.config.use_prior).and_then(|pose| self.state_of(pose, frame));
        let own = self.own_state(frame);
        let fresh = Some(self.fresh_state(frame));
        for (start, is_routed) in [(prior, true), (own, false), (fresh, false)] {
            let Some(start) = start else { continue };
            let coverage = self.integrator.integrate(&start, &self.history, frame.end_ns);
            if self.bridges(&coverage) {
                let end = self.integrator.end_state(&start);
                self.state = Some(if is_routed { end } else { self.settled(&start, end) });
                return Some(&self.integrator);
            }
        }
        None
    }

    /// Offset to add to IMU stamps as it was known last, nanoseconds.
    pub(crate) fn time_offset_ns(&self) -> i64 {
        self.state.map_or(0, |state| state.time_offset_ns)
    }

    fn restart(&mut self) {
        self.detector = StandstillDetector::default();
        self.history.clear();
        self.state = None;
    }

    fn take_samples(&mut self, samples: &[ImuSample], frame: &FrameHeader) {
        let oldest_ns = frame.start_ns - self.max_prior_age_ns() - MAX_OFFSET_NS;
        // One sample before the oldest time that may be asked for stays, to interpolate.
        let stale = self.history.partition_point(|sample| sample.stamp_ns < oldest_ns).saturating_sub(1);
        self.history.drain(..stale);
        let latest_ns = frame.end_ns + MAX_OFFSET_NS;
        for sample in samples {
            let is_new = self.history.last().is_none_or(|last| sample.stamp_ns > last.stamp_ns);
            // A stamp far in the future is a fault that would shut out all that follows.
            if !is_new || sample.stamp_ns > latest_ns {
                continue;
            }
            let conditioned = self.conditioner.push(sample);
            if let (Some(last), Some(corrected)) = (self.history.last_mut(), conditioned.previous) {
                *last = corrected;
            }
            self.detector.push(&conditioned.sample);
            if self.history.len() == HISTORY {
                self.history.drain(..HISTORY / 4);
            }
            self.history.push(conditioned.sample);
        }
    }

    /// The odometry's state, if it is fit to start from.
    fn state_of(&self, pose: &PoseFrame, frame: &FrameHeader) -> Option<ImuState> {
        // An odometry that starts in motion knows how it moves before it says where it is; one that still waits uses no points.
        let tracks = match pose.tracking_state() {
            Some(TrackingState::Tracking | TrackingState::Degenerate) => true,
            Some(TrackingState::Initialising) => f64::from(pose.quality) > SETTLING_QUALITY,
            _ => false,
        };
        let state = ImuState {
            time_ns: pose.frame.end_ns,
            world_from_imu: map_from_imu(pose).rotation,
            // Only differences of position count; the origin keeps them exact far away from the map's.
            position: Vector3::zeros(),
            velocity: pose.velocity.into(),
            gyro_bias: if self.is_held_at_zero() { Vector3::zeros() } else { pose.gyro_bias.into() },
            accel_bias: pose.accel_bias.into(),
            gravity: pose.gravity.into(),
            time_offset_ns: pose.time_offset_ns,
        };
        let turned = Vector4::from(pose.imu_orientation).norm();
        // Far beyond what a person, a robot or a MEMS sensor does; comparisons with NaN are false.
        let plausible = (turned - 1.0).abs() < 1e-3
            && state.velocity.norm() < 50.0
            && Vector3::from(pose.gyro_bias).norm() < 1.0
            && state.accel_bias.norm() < 5.0
            && (state.gravity.norm() - STANDARD_GRAVITY).abs() < 1.0
            && state.time_offset_ns.unsigned_abs() <= MAX_OFFSET_NS.unsigned_abs();
        (tracks && plausible && self.is_recent(state.time_ns, frame)).then_some(state)
    }

    /// Whether the gyroscope's firmware holds it at zero at the frame's end: its bias is taken off with the rest. Seen from the newest
    /// samples alone, so that an instance that was started again, whose standstill began at another sample or is not known to it, puts
    /// out the same bytes.
    fn is_held_at_zero(&self) -> bool {
        let newest = self.history.iter().rev().take(HELD_RUN);
        newest.take_while(|sample| sample.gyro == [0.0; 3]).count() == HELD_RUN
    }

    /// The state at the end of the last frame.
    fn own_state(&self, frame: &FrameHeader) -> Option<ImuState> {
        let state = self.state.filter(|state| self.is_recent(state.time_ns, frame))?;
        Some(self.at_rest(state).unwrap_or(state))
    }

    /// A start out of nothing at the frame's start: the IMU's own frame as the world, gravity against the mean specific force,
    /// no velocity, and the biases that were known last.
    fn fresh_state(&self, frame: &FrameHeader) -> ImuState {
        let force: Vector3<f64> = self
            .history
            .iter()
            .map(|sample| Vector3::from(sample.accel))
            .filter(|accel| accel.iter().all(|value| value.is_finite()))
            .sum();
        let up = force.try_normalize(1e-9).unwrap_or(Vector3::z());
        let known = self.state.as_ref();
        let standstill_bias = self.detector.standstill().and_then(|still| still.gyro_bias);
        let state = ImuState {
            time_ns: frame.start_ns,
            world_from_imu: UnitQuaternion::identity(),
            position: Vector3::zeros(),
            velocity: Vector3::zeros(),
            gyro_bias: known.map(|state| state.gyro_bias).or(standstill_bias).unwrap_or_default(),
            accel_bias: known.map(|state| state.accel_bias).unwrap_or_default(),
            gravity: up * -STANDARD_GRAVITY,
            time_offset_ns: known.map_or(0, |state| state.time_offset_ns),
        };
        self.at_rest(state).unwrap_or(state)
    }

    /// What the rig's rest says, while it lasts: no velocity, biases, and which way is down.
    fn at_rest(&self, state: ImuState) -> Option<ImuState> {
        let still = self.detector.rest()?;
        let up = still.mean_accel.try_normalize(1e-9)?;
        Some(ImuState {
            velocity: Vector3::zeros(),
            // A gyroscope whose firmware holds it at zero has had its bias removed there as well.
            gyro_bias: still.gyro_bias.unwrap_or_default(),
            accel_bias: still.mean_accel - up * STANDARD_GRAVITY,
            gravity: state.world_from_imu * up * -STANDARD_GRAVITY,
            ..state
        })
    }

    /// Keeps a state that no pose corrects from running away.
    fn settled(&self, start: &ImuState, end: ImuState) -> ImuState {
        let seconds = (end.time_ns - start.time_ns) as f64 * 1e-9;
        // Over many steps the acceleration averages to zero: what remains of it is an error of gravity.
        let gravity = start.gravity - (end.velocity - start.velocity) / LEVELLING_S;
        // What is faster than any carrier came out of bad samples; no velocity is the better guess then.
        let fade = if end.velocity.norm() > MAX_OWN_SPEED {
            0.0
        } else {
            (-seconds / self.config.velocity_decay_s).exp()
        };
        ImuState {
            velocity: end.velocity * fade,
            gravity: gravity.try_normalize(1e-9).map_or(start.gravity, |down| down * STANDARD_GRAVITY),
            position: Vector3::zeros(),
            ..end
        }
    }

    fn is_recent(&self, time_ns: i64, frame: &FrameHeader) -> bool {
        let age_ns = frame.start_ns.saturating_sub(time_ns);
        (-OVERLAP_NS..=self.max_prior_age_ns()).contains(&age_ns)
    }

    fn bridges(&self, coverage: &ImuCoverage) -> bool {
        let longest_ns =
            [coverage.longest_interval_ns, coverage.uncovered_start_ns, coverage.uncovered_end_ns];
        coverage.used > 0 && longest_ns.iter().all(|ns| *ns as f64 * 1e-9 <= self.config.max_imu_gap_s)
    }

    fn max_prior_age_ns(&self) -> i64 {
        (self.config.max_prior_age_s * 1e9) as i64
    }
}

/// Whether the frame's times can be true: a broken recording may say anything.
fn is_sound(frame: &FrameHeader) -> bool {
    let believable = frame.start_ns.unsigned_abs() < 1 << 62;
    believable && (0..=LONGEST_FRAME_NS).contains(&frame.end_ns.saturating_sub(frame.start_ns))
}

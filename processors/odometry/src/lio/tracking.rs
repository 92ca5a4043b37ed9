//! One frame of the running filter: propagate, match, and have it judged and mapped ([`super::mapping`]).

use evac_frames::{FrameHeader, MAX_TIME_OFFSET_NS, PoseFrame, TrackingState, scan_flags};
use evac_geometry::nalgebra::Vector3;
use evac_geometry::{MotionState, log_so3};
use evac_stage::{Counters, ScanWithImu};

use super::correction::{Gate, Report, correct};
use super::deskew::{Deskew, Middle, Twist};
use super::filter::Filter;
use super::habit::CLIMB_CHANGE;
use super::imu::Reading;
use super::information::FALSE;
use super::matching::{Known, select};
use super::offset_search::Found;
use super::propagation::{Noise, TracePoint, propagate};
use super::stage::{Lio, MAX_POINTS, MAX_SELECTED, valid};
use super::state::{State, uncouple_places};

/// Added to the gates of the associations: while all is well, while settling, and while lost or without an IMU, metres.
const GATE: &[f64] = &[0.0, 0.0];
const SETTLING_GATE: &[f64] = &[0.1, 0.05, 0.02];
const LOST_GATE: &[f64] = &[0.3, 0.2, 0.1, 0.05, 0.02, 0.01];
/// As [`FALSE`], for a start in motion: its map consists of scans that are half a second old at most, and a wall that fills the view shows up to
/// 2000 along itself there, all of it false. With 2500 two walks in halls began with half a metre per second sideways; 3500 and 5000
/// were alike; with 20000 some corridors gave no start for 50 s.
const FALSE_AT_START: f64 = 4000.0;
/// A frame at rest has the standstill's mean specific force and angular velocity within this, m/s^2 and rad/s: the onset of a
/// motion shows here before the detector believes it.
const REST_ACCEL: f64 = 0.04;
const REST_RATE: f64 = 0.003;
/// Below it a rig stands, turns on the spot or is about to, m/s. A steady glide looks like rest to an IMU; a filter that knows of one
/// is not stopped.
const SLOW_SPEED: f64 = 0.1;
/// Speed that is followed while lost, m/s: a false match may run away.
const LOST_SPEED: f64 = 0.8;
/// Times that a scan is matched again which the IMU did not cover.
const LED_ROUNDS: u32 = 2;

/// What a frame led to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    tracking: TrackingState,
    report: Report,
    /// What the search for the offset between the clocks came to, see [`super::retake`].
    pub(crate) found: Found,
}

impl Lio {
    pub(crate) fn track_frame(
        &mut self,
        input: &ScanWithImu<'_>,
        gap_s: f64,
        counters: &mut Counters,
    ) -> PoseFrame {
        let Some(mut filter) = self.filter.take() else { return PoseFrame::default() };
        let mut step = self.step(&mut filter, input, gap_s, counters);
        if let Some(offset_s) = self.retake.offset_s(step.found, &filter) {
            (filter, step) = self.take_again(filter, step, offset_s);
        }
        let Step { tracking, report, .. } = step;
        let frame = &input.header.frame;
        let pose = if tracking == TrackingState::Initialising {
            self.approach.restart();
            filter.settling_pose(frame, &self.imu_from_lidar, &report)
        } else {
            let mut pose = filter.published(frame, &self.imu_from_lidar, &report, tracking);
            let speed = if tracking == TrackingState::Lost { LOST_SPEED } else { self.config.max_speed_m_s };
            let moved = filter.carried.cap_magnitude(speed * gap_s);
            if self.approach.limit(&mut pose, &moved, &self.imu_from_lidar) {
                pose.state = TrackingState::Lost as u32;
            }
            pose
        };
        counters.degraded += u64::from(pose.state == TrackingState::Lost as u32);
        self.filter = Some(filter);
        pose
    }

    /// Takes the filter through a frame.
    pub(crate) fn step(
        &mut self,
        filter: &mut Filter,
        input: &ScanWithImu<'_>,
        gap_s: f64,
        counters: &mut Counters,
    ) -> Step {
        let before = (filter.state, filter.covariance);
        let since_ns = filter.stamp_ns;
        let is_led = self.predict(filter, input);
        self.keep(filter, input, gap_s, since_ns);
        if is_led {
            // What carried the pose on was a guess: how it went wrong says nothing about gravity or the sensors.
            uncouple_places(&mut filter.covariance);
        }
        let predicted = (filter.state, filter.covariance);
        self.following.predict((!is_led).then(|| filter.origin_from_imu()));
        let mut middle = self.middle(filter, input);
        if filter.settling.is_some() {
            // Scans that are smeared by an unknown velocity say nothing about the clocks.
            middle.twist = Twist::default();
        }
        counters.rejected += self.take_points(&filter.state, filter.frame, input);
        let scout = self.scout(filter, &middle);
        self.orient(filter, &middle, &input.header.frame, is_led);
        let mut report = self.correct(filter, &middle, is_led);
        if is_led {
            // The LiDAR has to find the motion inside the scan too: once more with the points brought to the end by what it found.
            for _ in 0..LED_ROUNDS {
                self.trace.clear();
                self.trace.push(TracePoint::on_the_way(&before.0, &filter.state, filter.stamp_ns, gap_s));
                self.take_points(&filter.state, filter.frame, input);
                (filter.state, filter.covariance) = predicted;
                report = self.correct(filter, &middle, is_led);
            }
        }
        filter.observe(&report);
        filter.sections.drift.look(self.matches.iter().map(|matched| matched.piece));
        if let Some(back) = filter.sections.drift.come_back() {
            filter.sections.displace(&back, &filter.state, &mut filter.covariance);
        }
        if !filter.is_finite() {
            (filter.state, filter.covariance) = before;
            filter.loosen();
        }
        let tracking = match filter.settling {
            Some(settling) => self.settle(filter, settling, &before.0),
            None => self.judge(filter, &report, &before.0, &predicted, gap_s),
        };
        let found = scout.map_or(Found::Searching, |scout| {
            self.search_offset(filter, &scout, &report, &input.header.frame)
        });
        let rate = log_so3(&(before.0.rotation.inverse() * filter.state.rotation)) / gap_s;
        if is_led {
            filter.habit.miss(&rate);
        } else {
            filter.habit.take(gap_s, &filter.state.velocity, &rate);
            if let Some(off) = filter.habit.off_since_gap(gap_s, &filter.state.velocity) {
                let up = -filter.state.gravity / filter.state.gravity.norm();
                filter.expect_climb(off.dot(&up), CLIMB_CHANGE);
            }
        }
        Step { tracking, report, found }
    }

    /// Corrects the filter by the match of the selected points with the map.
    fn correct(&mut self, filter: &mut Filter, middle: &Middle, is_led: bool) -> Report {
        let follows_imu = !filter.is_loose() && !is_led;
        let gate = Gate {
            range_noise: self.config.range_noise_m,
            // Where the match alone is followed the little that it shows is all there is.
            doubts_walls: follows_imu,
            always_false: match (filter.is_starting(), follows_imu) {
                (true, _) => FALSE_AT_START,
                (false, true) => FALSE,
                (false, false) => 0.0,
            },
            floors: match (filter.settling, filter.monitor.is_lost() || is_led) {
                (Some(_), _) => SETTLING_GATE,
                (None, true) => LOST_GATE,
                (None, false) => GATE,
            },
        };
        correct(
            &Known { map: &self.map, sections: &filter.sections },
            &self.selected,
            &mut filter.state,
            &mut filter.covariance,
            &middle.twist,
            &gate,
            &mut self.matches,
        )
    }

    /// Carries the filter on to the frame's end; returns whether the IMU was silent for most of it, so that the LiDAR leads.
    pub(crate) fn predict(&mut self, filter: &mut Filter, input: &ScanWithImu<'_>) -> bool {
        filter.frame = filter.frame.wrapping_add(1);
        let end_ns = input.header.frame.end_ns - filter.state.offset_ns();
        let at_rest = self.is_at_rest(filter.stamp_ns);
        let noise = Noise::new(
            &self.config,
            filter.noise_factor(),
            filter.is_loose() && filter.degeneracy.count == 0,
            at_rest,
            filter.offset_walk(),
        );
        let frame_ns = end_ns - filter.stamp_ns;
        let from = filter.state.position;
        let bridged = propagate(
            &mut filter.state,
            &mut filter.covariance,
            self.track.readings(),
            (filter.stamp_ns, end_ns),
            &filter.habit,
            &noise,
            &mut self.trace,
        );
        filter.carried = filter.state.position - from;
        self.diagnostics.imu_gaps += bridged.gaps;
        filter.hold_velocity();
        filter.stamp_ns = end_ns;
        // A change of the time offset may ask for them again.
        let kept_from_ns = self.retake.begin_ns().map_or(end_ns, |begin_ns| begin_ns.min(end_ns));
        self.track.forget_before(kept_from_ns - MAX_TIME_OFFSET_NS);
        // Before the map frame is fixed a standstill makes a start of its own.
        let is_slow =
            filter.settling.map_or(filter.state.velocity.norm() < SLOW_SPEED, |settling| !settling.starting);
        if is_slow && !self.glides && !filter.monitor.is_lost() {
            if at_rest {
                filter.rest();
            } else {
                filter.slow_down();
            }
        }
        bridged.blind_ns * 2 > frame_ns
    }

    /// The predicted motion in the middle of the scan.
    fn middle(&self, filter: &Filter, input: &ScanWithImu<'_>) -> Middle {
        let middle_ns = middle_ns(&input.header.frame) - filter.state.offset_ns();
        Middle::of(&self.trace, &filter.state, middle_ns)
    }

    /// Whether the IMU says that the rig has been standing and still does, in the readings since `since_ns`.
    pub(crate) fn is_at_rest(&self, since_ns: i64) -> bool {
        let (MotionState::Still, Some(standstill)) = (self.detector.state(), self.detector.standstill())
        else {
            return false;
        };
        let readings = self.track.readings_since(since_ns);
        let n = readings.len().max(1) as f64;
        let mean = |of: fn(&Reading) -> Vector3<f64>| readings.iter().map(of).sum::<Vector3<f64>>() / n;
        (mean(|reading| reading.accel) - standstill.mean_accel).norm() < REST_ACCEL
            && (mean(|reading| reading.gyro) - standstill.gyro_bias.unwrap_or_default()).norm() < REST_RATE
    }

    /// Takes points in the LiDAR frame at the frame's end, and those of them that go to the match; returns how many are none.
    pub(crate) fn take_points(&mut self, end: &State, frame: usize, input: &ScanWithImu<'_>) -> u64 {
        let deskewed = input.header.scan_flags & scan_flags::DESKEWED != 0;
        let mut deskew = (!deskewed).then(|| Deskew::new(&self.trace, end, &self.imu_from_lidar));
        let start_ns = input.header.frame.start_ns - end.offset_ns();
        let mut rejected = 0;
        self.points.clear();
        for point in input.points.iter().take(MAX_POINTS) {
            let Some(position) = valid(point, &self.config) else {
                rejected += 1;
                continue;
            };
            let stamp_ns = start_ns + point.offset_ns();
            self.points.push(deskew.as_mut().map_or(position, |deskew| deskew.apply(&position, stamp_ns)));
        }
        let stride = (self.config.point_stride as usize).max(self.points.len().div_ceil(MAX_SELECTED));
        let chosen = self.points.iter().skip(frame % stride).step_by(stride);
        self.selected.clear();
        self.selected.extend(chosen.map(|point| select(&self.imu_from_lidar, point)));
        rejected
    }
}

/// Middle of a frame by the LiDAR's clock.
pub(crate) fn middle_ns(frame: &FrameHeader) -> i64 {
    frame.start_ns + frame.end_ns.saturating_sub(frame.start_ns) / 2
}

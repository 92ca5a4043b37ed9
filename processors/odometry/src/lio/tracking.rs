//! One frame of the running filter: propagate, match, judge, map.

use evac_frames::{MAX_TIME_OFFSET_NS, PoseFrame, TrackingState, scan_flags};
use evac_geometry::nalgebra::{Matrix3, Vector3};
use evac_geometry::{MotionState, log_so3};
use evac_stage::{Counters, ScanWithImu};

use super::correction::{Gate, Report, correct};
use super::degeneracy::Degeneracy;
use super::deskew::Deskew;
use super::filter::Filter;
use super::imu::Reading;
use super::initialisation::upright;
use super::matching::{Known, select};
use super::monitor::{Expected, Verdict};
use super::offset_search::Found;
use super::propagation::{Noise, propagate};
use super::report::waiting_frame;
use super::settling::{Scratch, Settling};
use super::stage::{Lio, MAX_POINTS, MAX_SELECTED, insert_all, valid};
use super::state::{Covariance, State, add_variance, at};

/// Added to the gates of the associations: while all is well, while settling, for the scout and while lost, metres.
const GATE: &[f64] = &[0.0, 0.0];
const SETTLING_GATE: &[f64] = &[0.1, 0.05, 0.02];
const SCOUT_GATE: &[f64] = &[0.1, 0.03];
const LOST_GATE: &[f64] = &[0.3, 0.2, 0.1, 0.05, 0.02, 0.01];
/// A frame at rest has the standstill's mean specific force and angular velocity within this, m/s^2 and rad/s: the onset of a
/// motion shows here before the detector believes it.
const REST_ACCEL: f64 = 0.04;
const REST_RATE: f64 = 0.003;
/// A steady glide looks like rest to an IMU; a filter that knows of one is not stopped, m/s.
const REST_SPEED: f64 = 0.1;

/// A scan of which one point in so many sees no plane shows new ground.
const NEW_GROUND_SHARE: usize = 10;
/// A pose less certain than this is no place to lay new ground from as if it were exact, metres.
const SECTION_SIGMA: f64 = 0.005;
/// Scans farther apart than this have others missing between them, seconds.
const MAX_STEP_S: f64 = 0.25;
/// Frames within which the pose is back in an older section.
const RETURNING_FRAMES: u32 = 3;
/// What the scout is not told by the IMU, rad and m.
const SCOUT_ROTATION: f64 = 0.035;
const SCOUT_POSITION: f64 = 0.1;
/// A scan that leaves the scout less certain than this says too little, rad and m (standard deviations).
const SCOUT_KNOWS_ROTATION: f64 = 1.5e-3;
const SCOUT_KNOWS_POSITION: f64 = 0.02;
/// A filter this far from the scout has gone astray, m and rad.
const ASTRAY_POSITION: f64 = 0.1;
const ASTRAY_ROTATION: f64 = 0.012;

impl Lio {
    pub(crate) fn track_frame(
        &mut self,
        input: &ScanWithImu<'_>,
        gap_s: f64,
        counters: &mut Counters,
    ) -> PoseFrame {
        let Some(mut filter) = self.filter.take() else { return PoseFrame::default() };
        let before = (filter.state, filter.covariance);
        let rate = self.predict(&mut filter, input);
        let predicted = filter.state;
        self.take_points(&filter, input, counters);
        let gate = Gate {
            range_noise: self.config.range_noise_m,
            floors: match (filter.settling, filter.monitor.is_lost()) {
                (Some(_), _) => SETTLING_GATE,
                (None, true) => LOST_GATE,
                (None, false) => GATE,
            },
        };
        let scout = self.scout(&filter, &rate);
        let report = correct(
            &Known { map: &self.map, sections: &filter.sections },
            &self.selected,
            &mut filter.state,
            &mut filter.covariance,
            &rate,
            &gate,
            &mut self.matches,
        );
        filter.degeneracy = Degeneracy::of(&report.position_information);
        if !filter.is_finite() {
            (filter.state, filter.covariance) = before;
            filter.loosen();
        }
        let tracking = match filter.settling {
            Some(settling) => self.settle(&mut filter, settling, &before.0),
            None => self.judge(&mut filter, &report, &before.0, &predicted, gap_s),
        };
        if let Some(scout) = scout {
            self.search_offset(&mut filter, &scout, input.header.frame.end_ns);
        }
        filter.rate = log_so3(&(before.0.rotation.inverse() * filter.state.rotation)) / gap_s;
        counters.degraded += u64::from(tracking == TrackingState::Lost);
        let frame = &input.header.frame;
        let pose = match tracking {
            TrackingState::Initialising => {
                let up = filter.state.rotation.inverse() * -filter.state.gravity;
                waiting_frame(frame, &upright(&up, &self.imu_from_lidar), &self.imu_from_lidar)
            }
            _ => filter.published(frame, &self.imu_from_lidar, &report, tracking),
        };
        self.filter = Some(filter);
        pose
    }

    /// Carries the filter on to the frame's end; returns the angular velocity there.
    fn predict(&mut self, filter: &mut Filter, input: &ScanWithImu<'_>) -> Vector3<f64> {
        filter.frame = filter.frame.wrapping_add(1);
        let end_ns = input.header.frame.end_ns - filter.state.offset_ns();
        let at_rest = self.is_at_rest(filter.stamp_ns);
        let noise = Noise::new(
            &self.config,
            filter.noise_factor(),
            filter.is_loose() && filter.degeneracy.count == 0,
            at_rest,
        );
        self.diagnostics.imu_gaps += propagate(
            &mut filter.state,
            &mut filter.covariance,
            self.track.readings(),
            (filter.stamp_ns, end_ns),
            &filter.rate,
            &noise,
            &mut self.trace,
        );
        filter.stamp_ns = end_ns;
        // A change of the time offset may ask for them again.
        self.track.forget_before(end_ns - MAX_TIME_OFFSET_NS);
        if at_rest && !filter.is_loose() && filter.state.velocity.norm() < REST_SPEED {
            filter.rest();
        }
        self.trace.last().map_or(filter.rate, |last| last.rate)
    }

    /// Whether the IMU says that the rig has been standing and still does, in the readings since `since_ns`.
    fn is_at_rest(&self, since_ns: i64) -> bool {
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

    /// While the clocks' offset is searched for: the pose that the LiDAR alone gives, the IMU only saying where to begin.
    fn scout(&mut self, filter: &Filter, rate: &Vector3<f64>) -> Option<State> {
        if self.offset_search.is_over() || filter.settling.is_some() {
            return None;
        }
        let mut state = filter.state;
        let mut covariance = Covariance::zeros();
        add_variance(&mut covariance, at::ROTATION, SCOUT_ROTATION.powi(2));
        add_variance(&mut covariance, at::POSITION, SCOUT_POSITION.powi(2));
        let gate = Gate { range_noise: self.config.range_noise_m, floors: SCOUT_GATE };
        let report = correct(
            &Known { map: &self.map, sections: &filter.sections },
            &self.selected,
            &mut state,
            &mut covariance,
            rate,
            &gate,
            &mut self.matches,
        );
        let spread = |index: usize| {
            covariance.fixed_view::<3, 3>(index, index).into_owned().symmetric_eigenvalues().max()
        };
        let good = report.used * 2 > report.selected
            && spread(at::ROTATION) < SCOUT_KNOWS_ROTATION.powi(2)
            && spread(at::POSITION) < SCOUT_KNOWS_POSITION.powi(2)
            && state.is_finite();
        if !good {
            self.offset_search.interrupt();
        }
        good.then_some(state)
    }

    /// Compares what the LiDAR turned by with the gyroscope; a filter that has followed a wrong clock takes the scout's pose.
    fn search_offset(&mut self, filter: &mut Filter, scout: &State, end_ns: i64) {
        let found = self.offset_search.push_rotation(end_ns, scout.rotation, filter.state.time_offset_s);
        let astray = (scout.position - filter.state.position).norm() > ASTRAY_POSITION
            || scout.rotation.angle_to(&filter.state.rotation) > ASTRAY_ROTATION;
        if astray || matches!(found, Found::Changed(_)) {
            filter.state.rotation = scout.rotation;
            filter.state.position = scout.position;
            filter.loosen();
        }
        if let Found::Changed(offset_s) = found {
            self.diagnostics.offset_corrections += 1;
            filter.set_time_offset(offset_s);
            filter.stamp_ns = end_ns - filter.state.offset_ns();
        }
    }

    /// Points in the LiDAR frame at the frame's end, and those of them that go to the match.
    fn take_points(&mut self, filter: &Filter, input: &ScanWithImu<'_>, counters: &mut Counters) {
        let deskewed = input.header.scan_flags & scan_flags::DESKEWED != 0;
        let mut deskew = (!deskewed).then(|| Deskew::new(&self.trace, &filter.state, &self.imu_from_lidar));
        let start_ns = input.header.frame.start_ns - filter.state.offset_ns();
        self.points.clear();
        for point in input.points.iter().take(MAX_POINTS) {
            let Some(position) = valid(point, &self.config) else {
                counters.rejected += 1;
                continue;
            };
            let stamp_ns = start_ns + point.offset_ns();
            self.points.push(deskew.as_mut().map_or(position, |deskew| deskew.apply(&position, stamp_ns)));
        }
        let stride = (self.config.point_stride as usize).max(self.points.len().div_ceil(MAX_SELECTED));
        let chosen = self.points.iter().skip(filter.frame % stride).step_by(stride);
        self.selected.clear();
        self.selected.extend(chosen.map(|point| select(&self.imu_from_lidar, point)));
    }

    /// Judges the match and maps the scan if it was good.
    fn judge(
        &mut self,
        filter: &mut Filter,
        report: &Report,
        before: &State,
        predicted: &State,
        gap_s: f64,
    ) -> TrackingState {
        let degenerate = filter.degeneracy.count > 0;
        let expected =
            Expected { degenerate, returning: filter.returning > 0, after_gap: gap_s > MAX_STEP_S };
        filter.returning = filter.returning.saturating_sub(1);
        let verdict = filter.monitor.judge(report, expected, &filter.state, &self.config);
        self.diagnostics.nis = filter.monitor.nis();
        match verdict {
            Verdict::Good => {
                self.choose_section(filter, report);
                self.map.next_frame(filter.sections.current());
                self.insert_scan(filter);
                return if degenerate { TrackingState::Degenerate } else { TrackingState::Tracking };
            }
            Verdict::Doubtful => {
                return if degenerate { TrackingState::Degenerate } else { TrackingState::Tracking };
            }
            Verdict::JustLost => {
                // The correction that gave it away is not trusted.
                self.diagnostics.losses += 1;
                filter.state = *predicted;
                filter.loosen();
            }
            // What is not observed now rests on the IMU, which need not be at fault.
            Verdict::Lost if degenerate => {}
            Verdict::Lost => filter.loosen(),
            Verdict::Restart => {
                self.diagnostics.map_restarts += 1;
                filter.restart();
                self.map.clear();
            }
        }
        filter.hold_speed(before, &self.config);
        TrackingState::Lost
    }

    /// Whether the scan goes into the section that the pose is in, into a new one or back into an old one.
    fn choose_section(&mut self, filter: &mut Filter, report: &Report) {
        if let Some(id) = report.anchor {
            filter.sections.return_to(id, &filter.state, &mut filter.covariance);
            filter.returning = RETURNING_FRAMES;
            self.diagnostics.sections_returned_to += 1;
            return;
        }
        let unseen = report.selected - report.in_view;
        if unseen * NEW_GROUND_SHARE > report.selected && filter.position_sigma() > SECTION_SIGMA {
            filter.sections.begin(&filter.state, &mut filter.covariance);
            self.diagnostics.sections_begun += 1;
        }
    }

    /// One frame of scan-to-scan tracking.
    fn settle(&mut self, filter: &mut Filter, settling: Settling, before: &State) -> TrackingState {
        filter.hold_speed(before, &self.config);
        self.map.next_frame(filter.sections.current());
        let scratch = settling.step(filter);
        if scratch != Scratch::Extend {
            self.map.clear();
        }
        if scratch == Scratch::Done {
            if settling.starting {
                filter.rebase(&self.imu_from_lidar);
            }
            filter.degeneracy = Degeneracy::of(&Matrix3::zeros());
            return TrackingState::Degenerate;
        }
        self.insert_scan(filter);
        if settling.starting { TrackingState::Initialising } else { TrackingState::Lost }
    }

    fn insert_scan(&mut self, filter: &Filter) {
        let map_from_lidar = filter.state.map_from_imu() * self.imu_from_lidar;
        insert_all(&mut self.map, &map_from_lidar, self.points.iter().copied());
    }
}

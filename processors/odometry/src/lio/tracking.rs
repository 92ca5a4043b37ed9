//! One frame of the running filter: propagate, match, judge, map.

use evac_frames::{PoseFrame, TrackingState, scan_flags};
use evac_geometry::nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use evac_geometry::{MotionState, log_so3};
use evac_stage::{Counters, ScanWithImu};

use super::cell::PoseVariance;
use super::correction::{Gate, Report, correct};
use super::degeneracy::Degeneracy;
use super::deskew::Deskew;
use super::filter::Filter;
use super::imu::Reading;
use super::initialisation::upright;
use super::matching::select;
use super::monitor::Verdict;
use super::plane_map::PlaneMap;
use super::propagation::{Noise, propagate};
use super::report::waiting_frame;
use super::settling::{Scratch, Settling};
use super::stage::{Lio, MAX_POINTS, MAX_SELECTED, valid};
use super::state::State;

/// Added to the gates of the two associations while settling and while lost, metres.
const SETTLING_GATE: [f64; 2] = [0.1, 0.1];
const LOST_GATE: [f64; 2] = [0.1, 0.03];
/// A frame at rest has the standstill's mean specific force and angular velocity within this, m/s^2 and rad/s: the onset of a
/// motion shows here before the detector believes it.
const REST_ACCEL: f64 = 0.04;
const REST_RATE: f64 = 0.003;
/// A steady glide looks like rest to an IMU; a filter that knows of one is not stopped, m/s.
const REST_SPEED: f64 = 0.1;

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
                (None, false) => [0.0; 2],
            },
        };
        let report = correct(
            &self.map,
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
            None => self.judge(&mut filter, &report, &before.0, &predicted),
        };
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
        let at_rest = self.is_at_rest();
        let noise = Noise::new(&self.config, filter.noise_factor(), filter.is_loose(), at_rest);
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
        self.track.forget_before(end_ns);
        if at_rest && !filter.is_loose() && filter.state.velocity.norm() < REST_SPEED {
            filter.rest();
        }
        self.trace.last().map_or(filter.rate, |last| last.rate)
    }

    /// Whether the IMU says that the rig has been standing and still does.
    fn is_at_rest(&self) -> bool {
        let (MotionState::Still, Some(standstill)) = (self.detector.state(), self.detector.standstill())
        else {
            return false;
        };
        let readings = self.track.readings();
        let n = readings.len().max(1) as f64;
        let mean = |of: fn(&Reading) -> Vector3<f64>| readings.iter().map(of).sum::<Vector3<f64>>() / n;
        (mean(|reading| reading.accel) - standstill.mean_accel).norm() < REST_ACCEL
            && (mean(|reading| reading.gyro) - standstill.gyro_bias.unwrap_or_default()).norm() < REST_RATE
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
    ) -> TrackingState {
        let degenerate = filter.degeneracy.count > 0;
        let verdict = filter.monitor.judge(report, degenerate, &filter.state, &self.config);
        self.diagnostics.nis = filter.monitor.nis();
        match verdict {
            Verdict::Good => {
                let inherited = self.map.mean_born(self.matches.iter().map(|matched| matched.cell));
                filter.inherited = inherited.unwrap_or(filter.inherited);
                self.map.next_frame(filter.viewpoint(&self.imu_from_lidar));
                insert_all(&mut self.map, filter, &self.imu_from_lidar, &self.points);
                return if degenerate { TrackingState::Degenerate } else { TrackingState::Tracking };
            }
            Verdict::JustLost => {
                // The correction that gave it away is not trusted.
                self.diagnostics.losses += 1;
                filter.state = *predicted;
                filter.loosen();
            }
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

    /// One frame of scan-to-scan tracking.
    fn settle(&mut self, filter: &mut Filter, settling: Settling, before: &State) -> TrackingState {
        filter.hold_speed(before, &self.config);
        self.map.next_frame(PoseVariance::default());
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
        insert_all(&mut self.map, filter, &self.imu_from_lidar, &self.points);
        if settling.starting { TrackingState::Initialising } else { TrackingState::Lost }
    }
}

fn insert_all(map: &mut PlaneMap, filter: &Filter, imu_from_lidar: &Isometry3<f64>, points: &[Vector3<f64>]) {
    let map_from_lidar = filter.state.map_from_imu() * imu_from_lidar;
    for point in points {
        map.insert(&(map_from_lidar * Point3::from(*point)).coords);
    }
}

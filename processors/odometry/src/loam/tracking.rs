//! One frame of the running filter: predict, match, judge, map.

use evac_frames::{PoseFrame, TrackingState, scan_flags};
use evac_geometry::log_so3;
use evac_geometry::nalgebra::{Isometry3, SVector, UnitQuaternion, Vector3};
use evac_stage::{Counters, ScanWithImu};

use super::filter::{Filter, POSITION, ROTATION, STATES, VELOCITY};
use super::monitor::{Monitor, Verdict};
use super::motion::Span;
use super::observability::Degeneracy;
use super::registration::Report;
use super::report::{Drift, Quality, pose_frame};
use super::settling::{Scratch, Settling};
use super::stage::Loam;
use super::start::upright;
use super::sweep::{Path, Sweep};

/// Nominal time between frames, seconds; the limits below hold for it and grow with longer ones.
const FRAME_S: f64 = 0.1;
/// A match that moves the prediction farther than this is not believed, metres and radians.
const MAX_CORRECTION: f64 = 0.25;
const MAX_TURN: f64 = 0.2;
/// No pose is published farther than this from the one before, metres.
const MAX_STEP: f64 = 0.29;
/// While settling the velocity is not known yet and more is believed.
const SETTLING_CORRECTION: f64 = 0.5;
/// What a loss adds per frame, m/s and radians.
const LOST_SPEED: f64 = 0.2;
const LOST_TURN: f64 = 0.01;
/// Time constants with which a velocity is forgotten that nothing observes, with IMU and without, seconds: people stop, and
/// without IMU nobody sees it.
const FORGET_S: [f64; 2] = [5.0, 1.0];
/// Without IMU a turn is forgotten, seconds: a rotation that nothing observes would otherwise go on for ever.
const FORGET_TURN_S: f64 = 0.3;

impl Loam {
    pub(crate) fn track_frame(
        &mut self,
        input: &ScanWithImu<'_>,
        span: &Span<'_>,
        mut filter: Filter,
        counters: &mut Counters,
    ) -> PoseFrame {
        let before = filter;
        let inertial = self.motion.predict(&mut filter, span, &self.detector, &self.config);
        self.diagnostics.inertial_frames += u64::from(inertial);
        self.following.predict(inertial.then(|| filter.map_from_imu()));
        let sweep = sweep(input, &before);
        let mut report = self.registration.align(
            (&self.surface_map, &self.edge_map),
            &self.features,
            &self.imu_from_lidar,
            &filter,
            &sweep,
        );
        let possible = self.is_possible(&report.correction, &filter, &before, span.h);
        let predicted = filter;
        filter.correct(&report.correction, &report.information);
        if !filter.is_finite() {
            filter =
                if predicted.is_finite() { predicted } else { Filter { stamp_ns: span.end_ns, ..before } };
            report = Report::default();
        }
        let tracking = match self.settling {
            Some(settling) => {
                if !possible {
                    filter = predicted;
                    report.refuse();
                }
                self.settle(&mut filter, settling, &sweep, &report)
            }
            None => self.judge(&mut filter, &predicted, &mut report, possible, &sweep),
        };
        if inertial && tracking == TrackingState::Tracking && filter.velocity != Vector3::zeros() {
            filter.learn_biases(&report.correction, span.h);
        }
        forget_unobserved(
            &mut filter,
            &report.degeneracy,
            tracking,
            span.h / FORGET_S[usize::from(!inertial)],
        );
        filter.velocity = filter.velocity.cap_magnitude(self.config.max_speed_m_s);
        let rate = log_so3(&(before.rotation.inverse() * filter.rotation)) / span.h;
        filter.rate = if inertial { rate } else { rate * (-span.h / FORGET_TURN_S).exp() };
        let step = (filter.position - before.position).norm();
        self.drift.count(&filter, step, tracking != TrackingState::Tracking);
        counters.degraded += u64::from(tracking == TrackingState::Lost);
        self.filter = Some(filter);
        if tracking == TrackingState::Initialising {
            return self.last_pose(input, tracking);
        }
        let quality = Quality {
            degeneracy: report.degeneracy,
            share: report.used as f64 / report.selected.max(1) as f64,
            tracking,
            levelled: self.levelled,
        };
        pose_frame(&input.header.frame, &filter, &self.imu_from_lidar, &self.drift, &quality)
    }

    /// Whether the corrected pose makes no jump.
    fn is_possible(&self, d: &SVector<f64, STATES>, predicted: &Filter, before: &Filter, h: f64) -> bool {
        let longer = (h / FRAME_S).max(1.0);
        let shift: Vector3<f64> = d.fixed_rows::<3>(POSITION).into_owned();
        let turn = d.fixed_rows::<3>(ROTATION).norm();
        let starting = self.settling.is_some_and(|settling| settling.starting);
        let (correction, step) =
            if starting { (SETTLING_CORRECTION, f64::INFINITY) } else { (MAX_CORRECTION, MAX_STEP) };
        // NaN is not possible either.
        shift.norm() <= correction * longer
            && turn <= MAX_TURN * longer
            && (predicted.position + shift - before.position).norm() <= step * longer
    }

    /// Judges the match and maps the scan if it was good.
    fn judge(
        &mut self,
        filter: &mut Filter,
        predicted: &Filter,
        report: &mut Report,
        possible: bool,
        sweep: &Sweep,
    ) -> TrackingState {
        let verdict = self.monitor.judge(report, possible);
        if verdict == Verdict::Good {
            self.map_scan(filter, sweep);
            let degenerate = report.degeneracy.count > 0;
            return if degenerate { TrackingState::Degenerate } else { TrackingState::Tracking };
        }
        self.diagnostics.refused_matches += 1;
        if verdict == Verdict::Searching {
            return TrackingState::Lost;
        }
        *filter = *predicted;
        report.refuse();
        if verdict == Verdict::Doubtful {
            return TrackingState::Degenerate;
        }
        loosen(filter);
        self.diagnostics.losses += u64::from(verdict == Verdict::JustLost);
        if verdict == Verdict::Restart {
            self.diagnostics.map_restarts += 1;
            self.clear_map();
            self.settling = Some(Settling::after_loss());
            self.map_scan(filter, sweep);
        }
        TrackingState::Lost
    }

    /// One frame of scan-to-scan tracking.
    fn settle(
        &mut self,
        filter: &mut Filter,
        mut settling: Settling,
        sweep: &Sweep,
        report: &Report,
    ) -> TrackingState {
        let scratch = settling.step();
        self.settling = Some(settling);
        if scratch != Scratch::Extend {
            self.clear_map();
        }
        if scratch != Scratch::Done {
            self.map_scan(filter, sweep);
            return if settling.starting { TrackingState::Initialising } else { TrackingState::Lost };
        }
        self.settling = None;
        self.monitor = Monitor::default();
        let mut sweep = *sweep;
        if settling.starting {
            let new_from_old = self.rebase(filter);
            sweep.from = new_from_old * sweep.from;
            self.drift = Drift::default();
        }
        self.map_scan(filter, &sweep);
        if report.degeneracy.count > 0 { TrackingState::Degenerate } else { TrackingState::Tracking }
    }

    /// Makes the LiDAR's present place the map's origin, upright where gravity is known; returns the change of the frame.
    fn rebase(&self, filter: &mut Filter) -> Isometry3<f64> {
        let old = filter.map_from_imu();
        let rotation: UnitQuaternion<f64> = if self.levelled {
            upright(&(old.rotation.inverse() * Vector3::z()), &self.imu_from_lidar)
        } else {
            self.imu_from_lidar.rotation.inverse()
        };
        let position = -(rotation * self.imu_from_lidar.translation.vector);
        let speed = filter.covariance.fixed_view::<3, 3>(VELOCITY, VELOCITY).diagonal().max().max(0.0).sqrt();
        let tilt = if self.levelled { 0.02 } else { 1e-3 };
        let new =
            Filter::new(filter.stamp_ns, &Isometry3::from_parts(position.into(), rotation), speed, tilt);
        let new_from_old = new.map_from_imu() * old.inverse();
        *filter = Filter {
            position: new.position,
            rotation: new.rotation,
            covariance: new.covariance,
            velocity: new_from_old.rotation * filter.velocity,
            ..*filter
        };
        new_from_old
    }

    /// Adds the features of a scan that was taken at rest.
    pub(crate) fn map_still(&mut self, filter: &Filter) {
        let from = filter.map_from_imu();
        self.map_scan(filter, &Sweep { from, start_ns: 0, end_ns: 1, deskewed: true });
    }

    /// Adds the features of the present scan, and gives up what is far.
    pub(crate) fn map_scan(&mut self, filter: &Filter, sweep: &Sweep) {
        let path = Path::new(sweep, (filter.position, filter.rotation));
        let lidar = filter.position + filter.rotation * self.imu_from_lidar.translation.vector;
        for (list, map) in
            [(&self.features.surfaces, &mut self.surface_map), (&self.features.edges, &mut self.edge_map)]
        {
            for feature in list {
                let in_imu =
                    self.imu_from_lidar.rotation * feature.point + self.imu_from_lidar.translation.vector;
                map.insert(&path.place(&in_imu, feature.offset_ns).2);
            }
            map.forget_far(&lidar, self.drift.way());
        }
    }

    pub(crate) fn clear_map(&mut self) {
        self.surface_map.clear();
        self.edge_map.clear();
    }
}

/// Makes room for what a loss or a gap hid.
pub(crate) fn loosen(filter: &mut Filter) {
    filter.add_variance(VELOCITY, LOST_SPEED.powi(2));
    filter.add_variance(ROTATION, LOST_TURN.powi(2));
}

/// Where the scan's points are between the frame before and this one.
pub(crate) fn sweep(input: &ScanWithImu<'_>, before: &Filter) -> Sweep {
    let frame = &input.header.frame;
    Sweep {
        from: before.map_from_imu(),
        start_ns: frame.start_ns.saturating_sub(before.stamp_ns),
        end_ns: frame.end_ns.saturating_sub(before.stamp_ns),
        deskewed: input.header.scan_flags & scan_flags::DESKEWED != 0,
    }
}

/// Draws a velocity towards zero where nothing observes it.
fn forget_unobserved(filter: &mut Filter, degeneracy: &Degeneracy, tracking: TrackingState, ages: f64) {
    let share = 1.0 - (-ages).exp();
    if tracking == TrackingState::Lost {
        filter.velocity -= filter.velocity * share;
        return;
    }
    for axis in degeneracy.axes.iter().take(degeneracy.count) {
        filter.velocity -= axis * (axis.dot(&filter.velocity) * share);
    }
}

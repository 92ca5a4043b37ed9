//! Deskewer and odometry in one process, and the figures of a trajectory against the truth.
#![allow(dead_code, unreachable_pub, reason = "each test binary uses its own part")]

pub mod room;
pub mod truth;

use std::time::Instant;

use evac_deskewer::{Deskewer, DeskewerConfig};
use evac_frames::{ImuSample, Point, PoseFrame, ScanHeader, TrackingState};
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use evac_odometry::{Lio, LioConfig, Loam};
use evac_stage::{Counters, PoseOutput, Rig, ScanOutput, ScanWithImu, Stage};

/// An odometry as the tests see it.
pub trait Odometry: for<'a> Stage<Input<'a> = ScanWithImu<'a>, Output = PoseOutput> {
    /// Everything that it counted, for a line of print.
    fn said(&self) -> String;
    /// Times that the match was lost.
    fn losses(&self) -> u64;
}

impl Odometry for Lio {
    fn said(&self) -> String {
        format!("{:?}", self.diagnostics())
    }

    fn losses(&self) -> u64 {
        self.diagnostics().losses
    }
}

impl Odometry for Loam {
    fn said(&self) -> String {
        format!("{:?}", self.diagnostics())
    }

    fn losses(&self) -> u64 {
        self.diagnostics().losses
    }
}

/// The deskewer with the odometry's poses as its prior, as the lossless pipeline runs them.
pub struct Pipeline<S = Lio> {
    deskewer: Deskewer,
    pub odometry: S,
    scans: ScanOutput,
    pub poses: PoseOutput,
    pub counters: Counters,
    /// Time that the odometry took for each frame, milliseconds.
    pub milliseconds: Vec<f64>,
}

impl Pipeline {
    pub fn new(rig: &Rig) -> Self {
        Self::with(LioConfig::default(), rig)
    }
}

impl<S: Odometry> Pipeline<S> {
    pub fn with(config: S::Config, rig: &Rig) -> Self {
        Self::with_deskewer(DeskewerConfig::default(), config, rig)
    }

    pub fn with_deskewer(deskewer: DeskewerConfig, config: S::Config, rig: &Rig) -> Self {
        Self {
            deskewer: Deskewer::new(deskewer, rig).unwrap(),
            odometry: S::new(config, rig).unwrap(),
            scans: ScanOutput::default(),
            poses: PoseOutput::default(),
            counters: Counters::default(),
            milliseconds: Vec::new(),
        }
    }

    /// Feeds one frame and returns its pose.
    pub fn feed(&mut self, header: &ScanHeader, points: &[Point], imu: &[ImuSample]) -> PoseFrame {
        let prior = self.poses.memory.last().copied();
        let covers = imu.last().is_some_and(|sample| sample.stamp_ns >= header.frame.end_ns);
        let input = ScanWithImu { header, points, imu, imu_covers: covers, prior: prior.as_ref() };
        self.deskewer.process(input, &mut self.scans, &mut Counters::default()).unwrap();
        let (header, points) = self.scans.memory.pop().unwrap();
        let deskewed =
            ScanWithImu { header: &header, points: &points, imu, imu_covers: covers, prior: prior.as_ref() };
        let started = Instant::now();
        self.odometry.process(deskewed, &mut self.poses, &mut self.counters).unwrap();
        self.milliseconds.push(started.elapsed().as_secs_f64() * 1e3);
        *self.poses.memory.last().unwrap()
    }

    /// Poses published so far.
    pub fn trajectory(&self) -> &[PoseFrame] {
        &self.poses.memory
    }
}

/// How a trajectory compares with the truth, from the first frame that was tracked on.
#[derive(Debug, Clone, Copy)]
pub struct Figures {
    /// Frames tracked.
    pub frames: usize,
    /// Length of the true path, metres.
    pub path: f64,
    /// Root mean square and maximum of the position error after rigid alignment, metres.
    pub ape: f64,
    pub ape_max: f64,
    /// Error of the end relative to the start, metres and degrees.
    pub drift: f64,
    pub rotation_deg: f64,
    /// Share of frames whose error is below three published standard deviations.
    pub honest: f64,
    pub degenerate: usize,
    pub lost: usize,
}

impl Figures {
    pub fn of(estimate: &[PoseFrame], truth: &[Isometry3<f64>]) -> Self {
        let first =
            estimate.iter().position(|pose| pose.state != TrackingState::Initialising as u32).unwrap();
        let estimate = &estimate[first..];
        let truth = &truth[first..first + estimate.len()];
        let poses: Vec<_> = estimate.iter().map(map_from_lidar).collect();
        let alignment = align(&poses, truth);
        let errors: Vec<f64> = poses
            .iter()
            .zip(truth)
            .map(|(pose, truth)| ((alignment * pose).translation.vector - truth.translation.vector).norm())
            .collect();
        let end = |poses: &[Isometry3<f64>]| poses[0].inverse() * poses[poses.len() - 1];
        let difference = end(truth).inverse() * end(&poses);
        let in_state =
            |state: TrackingState| estimate.iter().filter(|pose| pose.state == state as u32).count();
        let honest =
            errors.iter().zip(estimate).filter(|(error, pose)| **error < 3.0 * position_sigma(pose)).count();
        Self {
            frames: errors.len(),
            path: truth.windows(2).map(|w| (w[1].translation.vector - w[0].translation.vector).norm()).sum(),
            ape: (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt(),
            ape_max: errors.iter().copied().fold(0.0, f64::max),
            drift: difference.translation.vector.norm(),
            rotation_deg: difference.rotation.angle().to_degrees(),
            honest: honest as f64 / errors.len() as f64,
            degenerate: in_state(TrackingState::Degenerate),
            lost: in_state(TrackingState::Lost),
        }
    }

    pub fn drift_percent(&self) -> f64 {
        100.0 * self.drift / self.path
    }
}

/// Standard deviation of the published position, metres.
pub fn position_sigma(pose: &PoseFrame) -> f64 {
    (pose.covariance[0] + pose.covariance[7] + pose.covariance[14]).sqrt()
}

/// The rigid motion that brings positions of `poses` closest to those of `truth` (Umeyama without scale).
fn align(poses: &[Isometry3<f64>], truth: &[Isometry3<f64>]) -> Isometry3<f64> {
    let mean = |poses: &[Isometry3<f64>]| {
        poses.iter().map(|p| p.translation.vector).sum::<Vector3<f64>>() / poses.len() as f64
    };
    let (from, to) = (mean(poses), mean(truth));
    let mut cross = Matrix3::zeros();
    for (pose, truth) in poses.iter().zip(truth) {
        cross += (truth.translation.vector - to) * (pose.translation.vector - from).transpose();
    }
    let svd = cross.svd(true, true);
    let (u, v) = (svd.u.unwrap(), svd.v_t.unwrap());
    let handed = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v).determinant().signum()));
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * handed * v));
    let moved = rotation * Point3::from(from);
    Isometry3::from_parts(Translation3::from(to - moved.coords), rotation)
}

/// Median and 99th percentile.
pub fn percentiles(values: &[f64]) -> (f64, f64) {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    (sorted[sorted.len() / 2], sorted[sorted.len() * 99 / 100])
}

/// Prints a walk's figures in one line.
pub fn print<S: Odometry>(name: &str, pipeline: &Pipeline<S>, figures: &Figures) {
    let (median, p99) = percentiles(&pipeline.milliseconds);
    println!(
        "{name}: {} frames, path {:.1} m, APE {:.4} m (max {:.4}), end drift {:.3} m = {:.3} %, end rotation {:.3} deg, \
         {median:.2} ms a frame (p99 {p99:.2}), within 3 sigma {:.2}, degenerate {}, lost {}, {}",
        figures.frames,
        figures.path,
        figures.ape,
        figures.ape_max,
        figures.drift,
        figures.drift_percent(),
        figures.rotation_deg,
        figures.honest,
        figures.degenerate,
        figures.lost,
        pipeline.odometry.said()
    );
}

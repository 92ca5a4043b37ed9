//! The stage: one scan with its IMU readings in, one pose out. Frames of a running filter are handled in
//! [`super::tracking`].

use evac_frames::{PoseFrame, TrackingState, scan_flags};
use evac_geometry::StandstillDetector;
use evac_geometry::nalgebra::Isometry3;
use evac_stage::{Counters, PoseOutput, Readiness, Rig, ScanWithImu, Stage, StageConfig, StageError};

use super::centroid_map::CentroidMap;
use super::config::LoamConfig;
use super::features::Features;
use super::filter::Filter;
use super::monitor::Monitor;
use super::motion::{Motion, Span};
use super::observability::Degeneracy;
use super::registration::Registration;
use super::report::{Drift, Quality, pose_frame, waiting_frame};
use super::settling::Settling;
use super::start::Start;
use crate::follow::{self, Following};

/// A step of the stamps beyond this, forward or back, is a new clock, seconds.
const MAX_GAP_S: f64 = 10.0;
const MAX_RETURN_S: f64 = 1.0;

/// Counts since the start, beyond what the run loop counts.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LoamDiagnostics {
    /// Voxels of the surface map.
    pub surface_voxels: u64,
    /// Voxels of the edge map.
    pub edge_voxels: u64,
    /// Voxels given up because they were far from the LiDAR or not seen for long.
    pub evicted_voxels: u64,
    /// Surface features of the last scan.
    pub surfaces: u64,
    /// Edge features of the last scan.
    pub edges: u64,
    /// Maps begun anew because the match stayed lost.
    pub map_restarts: u64,
    /// Times that the match was lost.
    pub losses: u64,
    /// Frames whose match was not believed.
    pub refused_matches: u64,
    /// Frames that were carried on by the IMU.
    pub inertial_frames: u64,
    /// Whether the start was made from a standstill.
    pub started_standing: bool,
}

/// The stage `loam`: edge and surface features, scan to map.
#[derive(Debug)]
pub struct Loam {
    pub(crate) config: LoamConfig,
    pub(crate) imu_from_lidar: Isometry3<f64>,
    pub(crate) detector: StandstillDetector,
    start: Start,
    pub(crate) motion: Motion,
    pub(crate) features: Features,
    pub(crate) registration: Registration,
    pub(crate) surface_map: CentroidMap,
    pub(crate) edge_map: CentroidMap,
    /// `None` until the start.
    pub(crate) filter: Option<Filter>,
    pub(crate) settling: Option<Settling>,
    pub(crate) monitor: Monitor,
    pub(crate) drift: Drift,
    /// The map's z is against gravity.
    pub(crate) levelled: bool,
    previous_end_ns: Option<i64>,
    pub(crate) following: Following,
    pub(crate) diagnostics: LoamDiagnostics,
}

impl Stage for Loam {
    const NAME: &'static str = "loam";
    type Config = LoamConfig;
    type Input<'a> = ScanWithImu<'a>;
    type Output = PoseOutput;

    fn new(config: LoamConfig, rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        let imu_from_lidar = rig.imu_from_lidar();
        if !imu_from_lidar.to_homogeneous().iter().all(|value| value.is_finite()) {
            return Err(StageError::Config(
                "[rig.imu_from_lidar] holds a value that is not finite; give metres and degrees".into(),
            ));
        }
        let map = |edge: f64| {
            CentroidMap::new(edge, config.max_voxels as usize, config.map_radius_m, config.map_way_m)
        };
        Ok(Self {
            config,
            imu_from_lidar,
            detector: StandstillDetector::default(),
            start: Start::new(),
            motion: Motion::new(),
            features: Features::new(&config),
            registration: Registration::new(&config),
            surface_map: map(config.surface_voxel_m),
            edge_map: map(config.edge_voxel_m),
            filter: None,
            settling: None,
            monitor: Monitor::default(),
            drift: Drift::default(),
            levelled: false,
            previous_end_ns: None,
            following: Following::default(),
            diagnostics: LoamDiagnostics::default(),
        })
    }

    fn process(
        &mut self,
        input: ScanWithImu<'_>,
        output: &mut PoseOutput,
        counters: &mut Counters,
    ) -> Result<(), StageError> {
        let imu_from_lidar = self.imu_from_lidar;
        let pose = follow::lead(self, &input, counters, &imu_from_lidar);
        self.diagnostics.surface_voxels = self.surface_map.len() as u64;
        self.diagnostics.edge_voxels = self.edge_map.len() as u64;
        self.diagnostics.evicted_voxels = self.surface_map.evicted + self.edge_map.evicted;
        output.publish(&pose)
    }

    fn follow(
        &mut self,
        input: ScanWithImu<'_>,
        routed: Option<&PoseFrame>,
    ) -> Result<Readiness, StageError> {
        Ok(follow::follow(self, &input, routed))
    }
}

impl Loam {
    /// What the stage counted beyond its health report.
    pub fn diagnostics(&self) -> &LoamDiagnostics {
        &self.diagnostics
    }

    /// Takes the frame's times, readings and features in; nothing for a frame from the past or of no length, which changes
    /// nothing.
    pub(crate) fn advance<'a>(
        &mut self,
        input: &ScanWithImu<'a>,
        counters: &mut Counters,
    ) -> Option<Span<'a>> {
        let frame = &input.header.frame;
        let previous_end_ns = self.previous_end_ns.unwrap_or(frame.start_ns);
        let gap_s = frame.end_ns.saturating_sub(previous_end_ns) as f64 * 1e-9;
        if (-MAX_RETURN_S..=0.0).contains(&gap_s) {
            counters.late += 1;
            return None;
        }
        self.previous_end_ns = Some(frame.end_ns);
        let frame_s = frame.end_ns.saturating_sub(frame.start_ns) as f64 * 1e-9;
        let new_clock = !(-MAX_RETURN_S..MAX_GAP_S).contains(&gap_s);
        let h = if new_clock { frame_s.clamp(1e-3, 1.0) } else { gap_s };
        if new_clock {
            self.detector = StandstillDetector::default();
            if let Some(filter) = &mut self.filter {
                // Nothing is known about the time between.
                filter.stamp_ns = frame.end_ns - (h * 1e9) as i64;
                super::tracking::loosen(filter);
            }
        }
        // What the deskewer did without, the odometry does without too: the paper's comparison.
        let deskewed = input.header.scan_flags & scan_flags::DESKEWED != 0;
        let imu = if deskewed { input.imu } else { &[] };
        for sample in imu {
            self.detector.push(sample);
        }
        counters.rejected += self.features.extract(input.points);
        self.diagnostics.surfaces = self.features.surfaces.len() as u64;
        self.diagnostics.edges = self.features.edges.len() as u64;
        Some(Span { end_ns: frame.end_ns, h, imu, levelled: self.levelled })
    }

    pub(crate) fn pose_of(&mut self, input: &ScanWithImu<'_>, counters: &mut Counters) -> PoseFrame {
        let Some(span) = self.advance(input, counters) else {
            return self.last_pose(input, TrackingState::Lost);
        };
        match self.filter {
            None => self.wait(input, &span),
            Some(filter) => self.track_frame(input, &span, filter, counters),
        }
    }

    /// The pose as it was, for a frame that is not used.
    pub(crate) fn last_pose(&self, input: &ScanWithImu<'_>, tracking: TrackingState) -> PoseFrame {
        let frame = &input.header.frame;
        match &self.filter {
            Some(filter) if self.settling.is_none_or(|settling| !settling.starting) => {
                let degeneracy = Degeneracy::nothing_observed();
                let quality = Quality { degeneracy, share: 0.0, tracking, levelled: self.levelled };
                pose_frame(frame, filter, &self.imu_from_lidar, &self.drift, &quality)
            }
            _ => {
                let rotation = self.start.orientation(&self.detector, &self.imu_from_lidar);
                waiting_frame(frame, &rotation, &self.imu_from_lidar, self.start.is_levelled())
            }
        }
    }

    fn wait(&mut self, input: &ScanWithImu<'_>, span: &Span<'_>) -> PoseFrame {
        self.start.take(span.imu, span.h);
        let with_imu = input.header.scan_flags & (scan_flags::DESKEWED | scan_flags::IMU_MISSING) != 0;
        let begun =
            self.start.begin(span.end_ns, with_imu, &self.detector, &self.config, &self.imu_from_lidar);
        let Some(begun) = begun else {
            return self.last_pose(input, TrackingState::Initialising);
        };
        self.diagnostics.started_standing = begun.standing;
        self.levelled = begun.levelled;
        self.filter = Some(begun.filter);
        if !begun.standing {
            self.settling = Some(Settling::at_start());
            self.map_still(&begun.filter);
            return self.last_pose(input, TrackingState::Initialising);
        }
        self.map_still(&begun.filter);
        let quality = Quality {
            degeneracy: Degeneracy::default(),
            share: 1.0,
            tracking: TrackingState::Tracking,
            levelled: self.levelled,
        };
        pose_frame(&input.header.frame, &begun.filter, &self.imu_from_lidar, &self.drift, &quality)
    }
}

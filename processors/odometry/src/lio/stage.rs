//! The stage: one scan with its IMU readings in, one pose out. Before the start it waits for a standstill here; frames
//! of a running filter are handled in [`super::tracking`].

use evac_frames::{MAX_TIME_OFFSET_NS, Point, PoseFrame, TrackingState};
use evac_geometry::nalgebra::{Isometry3, Vector3};
use evac_geometry::{MotionState, StandstillDetector};
use evac_stage::{Counters, PoseOutput, Readiness, Rig, ScanWithImu, Stage, StageConfig, StageError};

use super::approach::Approach;
use super::config::LioConfig;
use super::correction::Report;
use super::filter::Filter;
use super::imu::ImuTrack;
use super::initialisation::{Initialiser, Start, standing};
use super::matching::{Match, Selected};
use super::offset_search::OffsetSearch;
use super::orientation::ScanOrientation;
use super::plane_map::PlaneMap;
use super::propagation::TracePoint;
use super::report::waiting_frame;
use super::retake::Retake;
use super::sections::{SectionId, Sections};
use crate::follow::{self, Following};

/// Most points that go to the match and most that a frame is taken to have: 1000 in the match are enough.
pub(crate) const MAX_SELECTED: usize = 4096;
pub(crate) const MAX_POINTS: usize = 1 << 16;
/// Points of the standstill that are kept for the map: 40 frames of a Mid-40.
const MAX_STILL_POINTS: usize = 400_000;
/// Instants of one frame kept for deskewing: 1.28 s at 400 Hz.
const MAX_TRACE: usize = 512;
/// A step of the stamps beyond this, forward or back, is a new clock, seconds.
const MAX_GAP_S: f64 = 10.0;
const MAX_RETURN_S: f64 = 1.0;

/// Counts since the start, beyond what the run loop counts.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Diagnostics {
    /// Cells in the map.
    pub map_cells: u64,
    /// Cells given up to stay below the map's ceiling.
    pub evicted_cells: u64,
    /// Maps begun anew because the match stayed lost.
    pub map_restarts: u64,
    /// IMU samples that were not finite, impossible or too many.
    pub imu_rejected: u64,
    /// Single garbled IMU samples that were replaced by their neighbours.
    pub imu_spikes: u64,
    /// The IMU gives accelerations in g; they are converted.
    pub imu_in_g: bool,
    /// Gaps between IMU samples that were bridged.
    pub imu_gaps: u64,
    /// Corrections of the time offset by the coarse search.
    pub offset_corrections: u64,
    /// Sections of the map begun after the first, and returns to an older one.
    pub sections_begun: u64,
    /// As above.
    pub sections_returned_to: u64,
    /// Times that the match was lost.
    pub losses: u64,
    /// Whether the start was made from a standstill.
    pub started_standing: bool,
    /// Mean normalised innovation squared; healthy below 1.
    pub nis: f64,
}

/// The stage `lio`: tightly coupled LiDAR-inertial odometry, direct scan to map.
#[derive(Debug)]
pub struct Lio {
    pub(crate) config: LioConfig,
    pub(crate) imu_from_lidar: Isometry3<f64>,
    pub(crate) track: ImuTrack,
    pub(crate) detector: StandstillDetector,
    pub(crate) map: PlaneMap,
    pub(crate) offset_search: OffsetSearch,
    pub(crate) retake: Retake,
    initialiser: Initialiser,
    /// For the filter, which begins in the middle of a run where nothing may be allocated.
    pub(crate) sections: Option<Sections>,
    /// `None` until the start.
    pub(crate) filter: Option<Filter>,
    pub(crate) still: Vec<Vector3<f32>>,
    /// The IMU says that the rig stands, the LiDAR that it does not.
    pub(crate) glides: bool,
    pub(crate) points: Vec<Vector3<f64>>,
    pub(crate) selected: Vec<Selected>,
    pub(crate) matches: Vec<Match>,
    pub(crate) trace: Vec<TracePoint>,
    previous_end_ns: Option<i64>,
    pub(crate) following: Following,
    pub(crate) diagnostics: Diagnostics,
    /// For calibration: each scan is also matched by itself, with this result.
    pub(crate) orients_scans: bool,
    pub(crate) orientation: Option<ScanOrientation>,
    pub(crate) approach: Approach,
}

impl Stage for Lio {
    const NAME: &'static str = "lio";
    type Config = LioConfig;
    type Input<'a> = ScanWithImu<'a>;
    type Output = PoseOutput;

    fn new(config: LioConfig, rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        let imu_from_lidar = rig.imu_from_lidar();
        if !imu_from_lidar.to_homogeneous().iter().all(|value| value.is_finite()) {
            return Err(StageError::Config(
                "[rig.imu_from_lidar] holds a value that is not finite; give metres and degrees".into(),
            ));
        }
        Ok(Self {
            config,
            imu_from_lidar,
            track: ImuTrack::new(),
            detector: StandstillDetector::default(),
            map: PlaneMap::new(config.max_cells as usize, config.range_noise_m),
            offset_search: OffsetSearch::new(),
            retake: Retake::new(),
            initialiser: Initialiser::new(),
            sections: Some(Sections::new()),
            filter: None,
            still: Vec::with_capacity(MAX_STILL_POINTS),
            glides: false,
            points: Vec::with_capacity(MAX_POINTS),
            selected: Vec::with_capacity(MAX_SELECTED),
            matches: Vec::with_capacity(MAX_SELECTED),
            trace: Vec::with_capacity(MAX_TRACE),
            previous_end_ns: None,
            following: Following::default(),
            diagnostics: Diagnostics::default(),
            orients_scans: false,
            orientation: None,
            approach: Approach::default(),
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
        self.diagnostics.map_cells = self.map.len() as u64;
        self.diagnostics.evicted_cells = self.map.evicted;
        self.diagnostics.imu_rejected = self.track.rejected;
        self.diagnostics.imu_spikes = self.track.spikes();
        self.diagnostics.imu_in_g = self.track.is_in_g();
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

impl Lio {
    /// What the stage counted beyond its health report.
    pub fn diagnostics(&self) -> &Diagnostics {
        &self.diagnostics
    }

    /// Takes the frame's times and readings in; gives the seconds since the frame before and whether a new clock began, or
    /// nothing for a frame from the past or of no length, which changes nothing.
    pub(crate) fn advance(&mut self, input: &ScanWithImu<'_>) -> Option<(f64, bool)> {
        let frame = &input.header.frame;
        let previous_end_ns = self.previous_end_ns.unwrap_or(frame.start_ns);
        let gap_s = frame.end_ns.saturating_sub(previous_end_ns) as f64 * 1e-9;
        if (-MAX_RETURN_S..=0.0).contains(&gap_s) {
            return None;
        }
        self.previous_end_ns = Some(frame.end_ns);
        let new_clock = !(-MAX_RETURN_S..MAX_GAP_S).contains(&gap_s);
        if new_clock {
            self.track.clear();
            self.detector = StandstillDetector::default();
            self.offset_search.restart();
            if self.retake.is_open() {
                self.forget_start();
            }
        }
        self.track.extend(input.imu, frame.end_ns, |sample| {
            self.detector.push(sample);
            self.offset_search.push_rate(sample.stamp_ns, sample.gyro.into());
        });
        self.glides &= self.detector.state() == MotionState::Still;
        Some((gap_s, new_clock))
    }

    pub(crate) fn pose_of(&mut self, input: &ScanWithImu<'_>, counters: &mut Counters) -> PoseFrame {
        let Some((gap_s, new_clock)) = self.advance(input) else {
            counters.late += 1;
            return self.last_pose(input);
        };
        let frame = &input.header.frame;
        match &mut self.filter {
            None => self.wait(input, gap_s, counters),
            Some(filter) if filter.is_starting() && !new_clock => match self.stands_after_all(input) {
                Some(start) => self.begin(input, &start),
                None => self.track_frame(input, gap_s, counters),
            },
            Some(filter) if new_clock => {
                // Nothing is known about the time between.
                let frame_s =
                    (frame.end_ns.saturating_sub(frame.start_ns) as f64 * 1e-9).clamp(1e-3, MAX_GAP_S);
                filter.stamp_ns = frame.end_ns - (frame_s * 1e9) as i64 - filter.state.offset_ns();
                filter.loosen();
                self.track_frame(input, frame_s, counters)
            }
            Some(_) => self.track_frame(input, gap_s, counters),
        }
    }

    /// The pose as it was, for a frame that is not used.
    fn last_pose(&self, input: &ScanWithImu<'_>) -> PoseFrame {
        let frame = &input.header.frame;
        match &self.filter {
            Some(filter) => {
                filter.published(frame, &self.imu_from_lidar, &Report::default(), TrackingState::Lost)
            }
            None => waiting_frame(
                frame,
                &self.initialiser.orientation(&self.detector, &self.imu_from_lidar),
                &self.imu_from_lidar,
            ),
        }
    }

    fn wait(&mut self, input: &ScanWithImu<'_>, gap_s: f64, counters: &mut Counters) -> PoseFrame {
        self.initialiser.take(self.track.readings(), gap_s);
        counters.rejected += self.keep_still(input);
        match self.initialiser.start(&self.detector, self.glides, &self.config, &self.imu_from_lidar) {
            Some(start) if start.standing && self.has_moved(input, &start) => {
                self.glide();
                self.last_pose(input)
            }
            Some(start) => self.begin(input, &start),
            None => self.last_pose(input),
        }
    }

    /// The start from a standstill of a rig that was started in motion and comes to stand before its map frame is fixed: what the
    /// standstill says of gravity and sensors is worth more than what the motion did.
    fn stands_after_all(&mut self, input: &ScanWithImu<'_>) -> Option<Start> {
        self.keep_still(input);
        let start = standing(&self.detector, self.glides, &self.config, &self.imu_from_lidar)?;
        if self.has_moved(input, &start) {
            self.glide();
            return None;
        }
        Some(start)
    }

    /// Keeps the points of a standstill; returns how many are none.
    fn keep_still(&mut self, input: &ScanWithImu<'_>) -> u64 {
        // A motion voids the points of the standstill before it.
        if self.detector.state() == MotionState::Moving {
            self.still.clear();
        }
        let mut rejected = 0;
        for point in input.points {
            match valid(point, &self.config) {
                Some(_) if self.still.len() < MAX_STILL_POINTS => {
                    self.still.push(Vector3::new(point.x, point.y, point.z));
                }
                Some(_) => {}
                None => rejected += 1,
            }
        }
        rejected
    }

    /// The IMU says that the rig stands, and the scans that it does not.
    fn glide(&mut self) {
        self.glides = true;
        self.still.clear();
    }

    /// Starts the filter and maps the points of the standstill at the map's origin: mature planes from the first step.
    fn begin(&mut self, input: &ScanWithImu<'_>, start: &Start) -> PoseFrame {
        self.config.gyro_noise_rad_s = self.config.gyro_noise_rad_s.max(start.gyro_noise);
        self.config.accel_noise_m_s2 = self.config.accel_noise_m_s2.max(start.accel_noise);
        self.diagnostics.started_standing = start.standing;
        let frame = &input.header.frame;
        let filter = Filter::new(
            start,
            frame.end_ns,
            &self.config,
            self.sections.take().unwrap_or_else(Sections::new),
        );
        self.lay_standstill(&filter);
        if start.standing {
            self.retake.open(start, frame.end_ns, filter.state.time_offset_s);
        } else {
            // It may yet come to stand.
            self.still.clear();
        }
        self.track.forget_before(filter.stamp_ns - MAX_TIME_OFFSET_NS);
        let pose = if start.standing {
            filter.published(frame, &self.imu_from_lidar, &Report::full(), TrackingState::Tracking)
        } else {
            waiting_frame(frame, &start.state.rotation, &self.imu_from_lidar)
        };
        self.filter = Some(filter);
        pose
    }

    /// Makes the map of the standstill's points.
    pub(crate) fn lay_standstill(&mut self, filter: &Filter) {
        self.map.clear();
        self.map.next_frame(filter.sections.current(), filter.sections.drift.current());
        let map_from_lidar = filter.state.map_from_imu() * self.imu_from_lidar;
        insert_all(
            &mut self.map,
            &map_from_lidar,
            self.still.iter().map(|point| point.cast()),
            |_, point| *point,
        );
    }
}

/// A point in LiDAR coordinates, if it is one.
pub(crate) fn valid(point: &Point, config: &LioConfig) -> Option<Vector3<f64>> {
    let position = Vector3::new(f64::from(point.x), f64::from(point.y), f64::from(point.z));
    // NaN is outside every range.
    (config.min_range_m..=config.max_range_m).contains(&position.norm()).then_some(position)
}

/// Adds points in LiDAR coordinates to the map. They belong to the current section, whose frame `map_from_lidar` leads to; `in_section`
/// brings those that fall into other sections' cells into these sections' frames.
pub(crate) fn insert_all(
    map: &mut PlaneMap,
    map_from_lidar: &Isometry3<f64>,
    points: impl Iterator<Item = Vector3<f64>>,
    mut in_section: impl FnMut(SectionId, &Vector3<f64>) -> Vector3<f64>,
) {
    let rotation = map_from_lidar.rotation.to_rotation_matrix();
    for point in points {
        let way = rotation * point;
        map.insert_in(&(way + map_from_lidar.translation.vector), &way.normalize(), &mut in_section);
    }
}

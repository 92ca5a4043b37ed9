//! The stage: one scan with its IMU readings in, one pose out.

use evac_frames::{FrameHeader, Point, PoseFrame, TrackingState, scan_flags};
use evac_geometry::log_so3;
use evac_geometry::nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use evac_stage::{Counters, PoseOutput, Rig, ScanWithImu, Stage, StageConfig, StageError};

use super::cell::PoseVariance;
use super::config::LioConfig;
use super::correction::{Report, correct};
use super::degeneracy::Degeneracy;
use super::deskew::Deskew;
use super::imu::ImuTrack;
use super::initialisation::{Initialiser, Start, upright};
use super::matching::{Gate, Match, Selected, select};
use super::monitor::{Monitor, Verdict};
use super::plane_map::PlaneMap;
use super::propagation::{Noise, TracePoint, propagate};
use super::report::{lidar_covariance, pose_frame, waiting_frame};
use super::state::{Covariance, State, add_variance, at};

/// Most points that go to the match and most that a frame is taken to have: 1000 in the match are enough.
const MAX_SELECTED: usize = 4096;
const MAX_POINTS: usize = 1 << 16;
/// Points of the standstill that are kept for the map: 40 frames of a Mid-40.
const MAX_STILL_POINTS: usize = 400_000;
/// Instants of one frame kept for deskewing: 1.28 s at 400 Hz.
const MAX_TRACE: usize = 512;
/// A step of the stamps beyond this is a new clock and not a gap, seconds.
const MAX_GAP_S: f64 = 10.0;
/// Frames of scan-to-scan tracking before a map is laid.
const SETTLING_FRAMES: u32 = 15;
/// A map laid meanwhile is smeared and used for so many frames only.
const SETTLING_REFRESH: u32 = 5;
/// Errors of velocity and rotation (m/s, rad) between two scans that are smeared differently.
const SMEARED_VELOCITY: f64 = 0.5;
const SMEARED_ROTATION: f64 = 0.01;
/// Gate of the loose mode, metres.
const LOOSE_GATE: f64 = 0.1;
/// Uncertainty after a loss: rotation 1 degree, velocity, position (added to what it was).
const LOST_ROTATION: f64 = 0.0175;
const LOST_VELOCITY: f64 = 0.3;
const LOST_POSITION: f64 = 0.1;

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
    /// Gaps between IMU samples that were bridged.
    pub imu_gaps: u64,
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
    config: LioConfig,
    imu_from_lidar: Isometry3<f64>,
    track: ImuTrack,
    map: PlaneMap,
    phase: Phase,
    still: Vec<Vector3<f32>>,
    points: Vec<Vector3<f64>>,
    selected: Vec<Selected>,
    matches: Vec<Match>,
    trace: Vec<TracePoint>,
    previous_end_ns: Option<i64>,
    diagnostics: Diagnostics,
}

#[derive(Debug)]
enum Phase {
    Waiting(Initialiser),
    Running(Box<Filter>),
}

/// A running filter; its state holds at `stamp_ns` by the IMU's clock.
#[derive(Debug)]
struct Filter {
    state: State,
    covariance: Covariance,
    stamp_ns: i64,
    /// Mean angular velocity of the last frame, IMU frame, for when the IMU is silent.
    rate: Vector3<f64>,
    monitor: Monitor,
    degenerate: bool,
    degeneracy: Degeneracy,
    frame: u32,
    settling: Option<Settling>,
    /// Uncertainty that the map in view was laid with.
    inherited: PoseVariance,
}

/// Scan-to-scan tracking until the velocity is known well enough to lay a map: after a start in motion and after a loss
/// from which there was no way back.
#[derive(Debug, Clone, Copy)]
struct Settling {
    frames_left: u32,
    /// The map frame is not yet fixed: it will be where the LiDAR then is.
    starting: bool,
}

impl Stage for Lio {
    const NAME: &'static str = "lio";
    type Config = LioConfig;
    type Input<'a> = ScanWithImu<'a>;
    type Output = PoseOutput;

    fn new(config: LioConfig, rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        Ok(Self {
            config,
            imu_from_lidar: rig.imu_from_lidar(),
            track: ImuTrack::new(),
            map: PlaneMap::new(config.max_cells as usize),
            phase: Phase::Waiting(Initialiser::new()),
            still: Vec::with_capacity(MAX_STILL_POINTS),
            points: Vec::with_capacity(MAX_POINTS),
            selected: Vec::with_capacity(MAX_SELECTED),
            matches: Vec::with_capacity(MAX_SELECTED),
            trace: Vec::with_capacity(MAX_TRACE),
            previous_end_ns: None,
            diagnostics: Diagnostics::default(),
        })
    }

    fn process(
        &mut self,
        input: ScanWithImu<'_>,
        output: &mut PoseOutput,
        counters: &mut Counters,
    ) -> Result<(), StageError> {
        let pose = self.pose_of(&input, counters);
        self.diagnostics.map_cells = self.map.len() as u64;
        self.diagnostics.evicted_cells = self.map.evicted;
        self.diagnostics.imu_rejected = self.track.rejected;
        output.publish(&pose)
    }
}

impl Lio {
    /// What the stage counted beyond its health report.
    pub fn diagnostics(&self) -> &Diagnostics {
        &self.diagnostics
    }

    fn pose_of(&mut self, input: &ScanWithImu<'_>, counters: &mut Counters) -> PoseFrame {
        let frame = &input.header.frame;
        let previous_end_ns = self.previous_end_ns.unwrap_or(frame.start_ns);
        let gap_s = (frame.end_ns - previous_end_ns) as f64 * 1e-9;
        self.track.extend(input.imu);
        if let Phase::Running(filter) = &mut self.phase {
            if gap_s <= 0.0 {
                // A frame from the past changes nothing.
                counters.late += 1;
                return filter.published(
                    frame,
                    &self.imu_from_lidar,
                    &Report::default(),
                    TrackingState::Lost,
                );
            }
        }
        self.previous_end_ns = Some(frame.end_ns);
        match &mut self.phase {
            Phase::Waiting(initialiser) => {
                let standing = initialiser.take(input.imu, self.track.readings(), gap_s);
                let start = initialiser.start(&self.config, &self.imu_from_lidar);
                let orientation = initialiser.orientation(&self.imu_from_lidar);
                self.collect_still(input, standing, counters);
                match start {
                    Some(start) => self.begin(input, &start),
                    None => waiting_frame(frame, &orientation, &self.imu_from_lidar),
                }
            }
            Phase::Running(_) => self.track_frame(input, gap_s, counters),
        }
    }

    /// Keeps the points of a standstill; a motion voids them.
    fn collect_still(&mut self, input: &ScanWithImu<'_>, standing: bool, counters: &mut Counters) {
        if !standing {
            self.still.clear();
        }
        for point in input.points {
            match valid(point, &self.config) {
                Some(_) if self.still.len() < MAX_STILL_POINTS => {
                    self.still.push(Vector3::new(point.x, point.y, point.z));
                }
                Some(_) => {}
                None => counters.rejected += 1,
            }
        }
    }

    /// Starts the filter and maps the points of the standstill at the map's origin: mature planes from the first step.
    fn begin(&mut self, input: &ScanWithImu<'_>, start: &Start) -> PoseFrame {
        self.config.gyro_noise_rad_s = self.config.gyro_noise_rad_s.max(start.gyro_noise);
        self.config.accel_noise_m_s2 = self.config.accel_noise_m_s2.max(start.accel_noise);
        self.diagnostics.started_standing = start.standing;
        let mut filter = Filter {
            state: start.state,
            covariance: start.covariance,
            stamp_ns: input.header.frame.end_ns,
            rate: Vector3::zeros(),
            monitor: Monitor::default(),
            degenerate: false,
            degeneracy: Degeneracy::default(),
            frame: 0,
            settling: (!start.standing).then_some(Settling { frames_left: SETTLING_FRAMES, starting: true }),
            inherited: PoseVariance::default(),
        };
        filter.covariance[(at::TIME_OFFSET, at::TIME_OFFSET)] =
            (self.config.time_offset_sigma_ms * 1e-3).powi(2);
        add_variance(&mut filter.covariance, at::GYRO_SCALE, self.config.gyro_scale_sigma.powi(2));
        let map_from_lidar = filter.state.map_from_imu() * self.imu_from_lidar;
        for point in &self.still {
            self.map.insert(&(map_from_lidar * Point3::from(point.cast::<f64>())).coords);
        }
        self.still = Vec::new();
        self.track.forget_before(filter.stamp_ns);
        let pose = if start.standing {
            filter.published(
                &input.header.frame,
                &self.imu_from_lidar,
                &Report::full(),
                TrackingState::Tracking,
            )
        } else {
            waiting_frame(&input.header.frame, &start.state.rotation, &self.imu_from_lidar)
        };
        self.phase = Phase::Running(Box::new(filter));
        pose
    }

    fn track_frame(&mut self, input: &ScanWithImu<'_>, gap_s: f64, counters: &mut Counters) -> PoseFrame {
        let frame = &input.header.frame;
        let Phase::Running(filter) = &mut self.phase else { return PoseFrame::default() };
        let before = (filter.state, filter.covariance);
        filter.frame = filter.frame.wrapping_add(1);
        let offset_ns = (filter.state.time_offset_s * 1e9) as i64;
        let end_ns = frame.end_ns - offset_ns;
        if gap_s > MAX_GAP_S {
            // The stamps stepped: nothing is known about the time between.
            filter.stamp_ns = end_ns - 1;
            filter.loosen();
        }
        let loose = filter.monitor.is_lost() || filter.settling.is_some();
        let noise = Noise::new(&self.config, filter.noise_factor(), loose);
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

        let deskewed = input.header.scan_flags & scan_flags::DESKEWED != 0;
        let mut deskew = (!deskewed).then(|| Deskew::new(&self.trace, &filter.state, &self.imu_from_lidar));
        self.points.clear();
        for point in input.points.iter().take(MAX_POINTS) {
            let Some(position) = valid(point, &self.config) else {
                counters.rejected += 1;
                continue;
            };
            let stamp_ns = frame.start_ns + point.offset_ns() - offset_ns;
            self.points.push(deskew.as_mut().map_or(position, |deskew| deskew.apply(&position, stamp_ns)));
        }
        let stride = (self.config.point_stride as usize).max(self.points.len().div_ceil(MAX_SELECTED));
        self.selected.clear();
        let first = filter.frame as usize % stride;
        self.selected.extend(
            self.points.iter().skip(first).step_by(stride).map(|point| select(&self.imu_from_lidar, point)),
        );

        let gate =
            Gate { range_noise: self.config.range_noise_m, floor: if loose { LOOSE_GATE } else { 0.0 } };
        let rate = self.trace.last().map_or(filter.rate, |last| last.rate);
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
        filter.degenerate = filter.degeneracy.count > 0;
        if !filter.is_finite() {
            (filter.state, filter.covariance) = before;
            filter.loosen();
        }
        if let Some(settling) = filter.settling {
            return self.settle(frame, settling, &before.0, gap_s);
        }
        let verdict = filter.monitor.judge(&report, filter.degenerate, &filter.state, &self.config);
        match verdict {
            Verdict::Good => {}
            Verdict::JustLost => {
                // The correction that gave it away is not trusted.
                self.diagnostics.losses += 1;
                filter.hold_speed(&before.0, &self.config);
                filter.loosen();
            }
            Verdict::Lost => filter.hold_speed(&before.0, &self.config),
            Verdict::Restart => {
                self.diagnostics.map_restarts += 1;
                filter.hold_speed(&before.0, &self.config);
                filter.settling = Some(Settling { frames_left: SETTLING_FRAMES, starting: false });
                self.map.clear();
            }
        }
        filter.rate = log_so3(&(before.0.rotation.inverse() * filter.state.rotation)) / gap_s;
        if let Some(inherited) = self.map.mean_born(self.matches.iter().map(|matched| matched.cell)) {
            filter.inherited = inherited;
        }
        self.map.next_frame(filter.viewpoint(&self.imu_from_lidar));
        if matches!(verdict, Verdict::Good | Verdict::Restart) {
            insert_all(&mut self.map, &(filter.state.map_from_imu() * self.imu_from_lidar), &self.points);
        }
        self.diagnostics.nis = filter.monitor.nis();
        let tracking = match verdict {
            Verdict::JustLost | Verdict::Lost | Verdict::Restart => TrackingState::Lost,
            _ if filter.degenerate => TrackingState::Degenerate,
            _ => TrackingState::Tracking,
        };
        filter.published(frame, &self.imu_from_lidar, &report, tracking)
    }

    /// One frame of scan-to-scan tracking: the map is this scan alone. Both scans of a pair are smeared alike by a
    /// velocity that their deskewing did not know, so their distance is right. The map itself begins with the next
    /// frame, the first that is deskewed with a known velocity.
    fn settle(&mut self, frame: &FrameHeader, settling: Settling, before: &State, gap_s: f64) -> PoseFrame {
        let Phase::Running(filter) = &mut self.phase else { return PoseFrame::default() };
        filter.hold_speed(before, &self.config);
        filter.rate = log_so3(&(before.rotation.inverse() * filter.state.rotation)) / gap_s;
        if settling.frames_left <= 1 || settling.frames_left % SETTLING_REFRESH == 0 {
            self.map.clear();
        }
        self.map.next_frame(PoseVariance::default());
        // A displacement between smeared scans is no measure of acceleration or rate: gravity and biases must not follow it.
        if settling.frames_left > SETTLING_REFRESH {
            add_variance(&mut filter.covariance, at::VELOCITY, SMEARED_VELOCITY.powi(2));
            add_variance(&mut filter.covariance, at::ROTATION, SMEARED_ROTATION.powi(2));
        }
        if settling.frames_left > 1 {
            insert_all(&mut self.map, &(filter.state.map_from_imu() * self.imu_from_lidar), &self.points);
            filter.settling = Some(Settling { frames_left: settling.frames_left - 1, ..settling });
            if settling.starting {
                let up =
                    upright(&(filter.state.rotation.inverse() * -filter.state.gravity), &self.imu_from_lidar);
                return waiting_frame(frame, &up, &self.imu_from_lidar);
            }
            return filter.published(frame, &self.imu_from_lidar, &Report::default(), TrackingState::Lost);
        }
        filter.settling = None;
        if settling.starting {
            filter.rebase(&self.imu_from_lidar);
        }
        filter.degeneracy = Degeneracy::of(&Matrix3::zeros());
        filter.published(frame, &self.imu_from_lidar, &Report::default(), TrackingState::Degenerate)
    }
}

impl Filter {
    /// Fixes the map frame where the LiDAR is now: origin, z against gravity, yaw of the LiDAR zero.
    fn rebase(&mut self, imu_from_lidar: &Isometry3<f64>) {
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
        // The pose is exact by definition now.
        for index in at::ROTATION..at::TIME_OFFSET {
            turn[(index, index)] = 0.0;
        }
        self.covariance = turn * self.covariance * turn.transpose();
        add_variance(&mut self.covariance, at::ROTATION, 1e-10);
        add_variance(&mut self.covariance, at::POSITION, 1e-10);
    }

    /// Scale of the process noise, frozen at one while a direction rests on the IMU alone: loose velocity there would
    /// cost what the frames before have learnt.
    fn noise_factor(&self) -> f64 {
        if self.degenerate { 1.0 } else { self.monitor.noise_factor() }
    }

    /// After a loss: what was believed is believed less.
    fn loosen(&mut self) {
        let position: Matrix3<f64> =
            self.covariance.fixed_view::<3, 3>(at::POSITION, at::POSITION).into_owned();
        let sigma = position.symmetric_eigenvalues().max().max(0.0).sqrt() + LOST_POSITION;
        add_variance(&mut self.covariance, at::POSITION, sigma * sigma);
        add_variance(&mut self.covariance, at::ROTATION, LOST_ROTATION.powi(2));
        add_variance(&mut self.covariance, at::VELOCITY, LOST_VELOCITY.powi(2));
    }

    /// Takes back what no carrier does: too fast a motion, too large a bias.
    fn hold_speed(&mut self, before: &State, config: &LioConfig) {
        if self.state.velocity.norm() > config.max_speed_m_s {
            self.state.velocity = Vector3::zeros();
            self.state.position = before.position;
            add_variance(&mut self.covariance, at::VELOCITY, 1.0);
        }
        if self.state.accel_bias.norm() > 0.5 {
            self.state.accel_bias = Vector3::zeros();
        }
    }

    /// Uncertainty that cells get which are first seen from here.
    fn viewpoint(&self, imu_from_lidar: &Isometry3<f64>) -> PoseVariance {
        let covariance = lidar_covariance(&self.state, &self.covariance, imu_from_lidar, &self.inherited);
        let variance = |i: usize| covariance[7 * i] as f32;
        PoseVariance {
            position: [variance(0), variance(1), variance(2)],
            rotation: variance(3).max(variance(4)).max(variance(5)),
        }
    }

    fn is_finite(&self) -> bool {
        self.state.is_finite() && self.covariance.iter().all(|x| x.is_finite())
    }

    fn published(
        &self,
        frame: &FrameHeader,
        imu_from_lidar: &Isometry3<f64>,
        report: &Report,
        tracking: TrackingState,
    ) -> PoseFrame {
        let quality = report.used as f64 / report.selected.max(1) as f64;
        pose_frame(
            frame,
            &self.state,
            &self.covariance,
            imu_from_lidar,
            &self.degeneracy,
            quality,
            tracking,
            &self.inherited,
        )
    }
}

fn insert_all(map: &mut PlaneMap, map_from_lidar: &Isometry3<f64>, points: &[Vector3<f64>]) {
    for point in points {
        map.insert(&(map_from_lidar * Point3::from(*point)).coords);
    }
}

/// A point in LiDAR coordinates, if it is one.
fn valid(point: &Point, config: &LioConfig) -> Option<Vector3<f64>> {
    let position = Vector3::new(f64::from(point.x), f64::from(point.y), f64::from(point.z));
    // NaN is outside every range.
    (config.min_range_m..=config.max_range_m).contains(&position.norm()).then_some(position)
}

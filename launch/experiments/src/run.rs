//! Deskewer and odometry over a walk, in one process, as the lossless pipeline runs them.

use evac_deskewer::Deskewer;
use evac_evaluation::Pairs;
use evac_frames::{ImuSample, PoseFrame, TrackingState, frame_flags};
use evac_geometry::nalgebra::{Isometry3, Vector3};
use evac_odometry::{Lio, Loam};
use evac_stage::{Counters, PoseOutput, Rig, ScanOutput, ScanWithImu, Stage, StageError};
use rustix::time::{ClockId, Timespec, clock_gettime};

use crate::loss::pairs;
use crate::settings::OdometryKind;
use crate::walls::blank_wall;
use crate::{Frame, Settings, View, Walk};

/// What came out for one frame.
#[derive(Debug, Clone, Copy)]
pub struct FrameResult {
    /// What the odometry published.
    pub pose: PoseFrame,
    /// True pose of the LiDAR at the frame's end.
    pub truth: Isometry3<f64>,
    /// Normal of the blank wall that the scan shows, LiDAR frame, if it shows nothing else: by the true shape of what is seen where that is
    /// known, else by the scan.
    pub wall: Option<Vector3<f64>>,
    /// Directions that the wall leaves open for certain: both by its true shape; one by the scan, a tenth of which may show the other.
    pub open: usize,
    /// Time that the deskewer computed, milliseconds.
    pub deskewer_ms: f64,
    /// Time that the odometry computed, milliseconds.
    pub odometry_ms: f64,
}

/// A whole run.
#[derive(Debug, Clone, Default)]
pub struct Trajectory {
    /// One for each frame up to the end or to where a stage gave up.
    pub frames: Vec<FrameResult>,
    /// What the stage said that refused to go on.
    pub refused: Option<String>,
    /// What the odometry counted, for people.
    pub diagnostics: String,
}

impl Trajectory {
    /// The frames from the first one with a pose on.
    pub fn tracked(&self) -> &[FrameResult] {
        let waiting = |frame: &&FrameResult| frame.pose.state == TrackingState::Initialising as u32;
        let before = self.frames.iter().take_while(waiting).count();
        self.frames.get(before..).unwrap_or_default()
    }

    /// True and published poses from the first pose on; `None` where there is none or one is not finite.
    pub fn pairs(&self) -> Option<Pairs> {
        pairs(self.tracked())
    }
}

/// Runs a walk with the rig that it names.
pub fn run(walk: &Walk, settings: &Settings) -> Trajectory {
    match settings.odometry {
        OdometryKind::Lio => {
            run_stage::<Lio>(walk, settings, settings.lio, |lio| format!("{:?}", lio.diagnostics()))
        }
        OdometryKind::Loam => {
            run_stage::<Loam>(walk, settings, settings.loam, |loam| format!("{:?}", loam.diagnostics()))
        }
    }
}

fn run_stage<S>(
    walk: &Walk,
    settings: &Settings,
    config: S::Config,
    diagnostics: impl Fn(&S) -> String,
) -> Trajectory
where
    S: for<'a> Stage<Input<'a> = ScanWithImu<'a>, Output = PoseOutput>,
{
    let mut run = Trajectory { frames: Vec::with_capacity(walk.frames.len()), ..Trajectory::default() };
    let mut pipeline = match Pipeline::<S>::new(settings, config, &walk.rig) {
        Ok(pipeline) => pipeline,
        Err(cause) => return Trajectory { refused: Some(cause.to_string()), ..run },
    };
    let stream = walk.imu();
    for frame in &walk.frames {
        match pipeline.feed(frame, &stream) {
            Ok(result) => run.frames.push(result),
            Err(cause) => {
                run.refused = Some(cause.to_string());
                break;
            }
        }
    }
    run.diagnostics = diagnostics(&pipeline.odometry);
    run
}

/// Deskewer and odometry, frame by frame.
#[derive(Debug)]
pub struct Pipeline<S> {
    deskewer: Deskewer,
    odometry: S,
    scans: ScanOutput,
    poses: PoseOutput,
}

impl<S> Pipeline<S>
where
    S: for<'a> Stage<Input<'a> = ScanWithImu<'a>, Output = PoseOutput>,
{
    /// Both stages, not yet started.
    ///
    /// # Errors
    /// [`StageError`] for a configuration that one of them refuses.
    pub fn new(settings: &Settings, config: S::Config, rig: &Rig) -> Result<Self, StageError> {
        Ok(Self {
            deskewer: Deskewer::new(settings.deskewer.clone(), rig)?,
            odometry: S::new(config, rig)?,
            scans: ScanOutput::newest_only(),
            poses: PoseOutput::newest_only(),
        })
    }

    /// The odometry.
    pub fn odometry(&self) -> &S {
        &self.odometry
    }

    /// As above.
    pub fn odometry_mut(&mut self) -> &mut S {
        &mut self.odometry
    }

    /// Runs one frame through both. `stream` are all IMU samples of the walk.
    ///
    /// # Errors
    /// [`StageError`] of the stage that gives up.
    pub fn feed(&mut self, frame: &Frame, stream: &[ImuSample]) -> Result<FrameResult, StageError> {
        let Frame { header, points, imu, truth, view } = frame;
        let prior = self.poses.memory.last().copied();
        // The run loop waits for cover, longer where the IMU's stamps are known to run ahead; after the stream's last sample
        // there is nothing to wait for.
        let imu_end_ns = header.imu_end_ns(prior.map_or(0, |pose| pose.time_offset_ns));
        let imu = until(stream, imu, imu_end_ns);
        let imu_covers = imu
            .last()
            .is_some_and(|last| last.stamp_ns >= imu_end_ns || last.flags & frame_flags::END_OF_STREAM != 0);
        let input = ScanWithImu { header, points, imu, imu_covers, prior: prior.as_ref() };
        let started = computed();
        self.deskewer.process(input, &mut self.scans, &mut Counters::default())?;
        let deskewer_ms = milliseconds(started);
        let deskewed = self.scans.memory.last();
        let (header, points) = deskewed.map_or((header, &points[..]), |(header, points)| (header, points));
        let input = ScanWithImu { header, points, imu, imu_covers, prior: None };
        let started = computed();
        self.odometry.process(input, &mut self.poses, &mut Counters::default())?;
        let odometry_ms = milliseconds(started);
        let pose = self.poses.memory.last().copied().unwrap_or_default();
        let (wall, open) = match view {
            View::Unknown => (blank_wall(points).map(|wall| wall.normal), 1),
            View::Varied => (None, 0),
            View::BlankWall(normal) => (Some(*normal), 2),
        };
        Ok(FrameResult { pose, truth: *truth, wall, open, deskewer_ms, odometry_ms })
    }
}

/// What this thread has computed so far: other processes on a busy machine do not count, waiting for them neither.
fn computed() -> Timespec {
    clock_gettime(ClockId::ThreadCPUTime)
}

fn milliseconds(since: Timespec) -> f64 {
    let now = computed();
    (now.tv_sec - since.tv_sec) as f64 * 1e3 + (now.tv_nsec - since.tv_nsec) as f64 * 1e-6
}

/// The samples `imu` of one frame out of the whole `stream`, and those after them to the first one at or after `end_ns`.
fn until<'a>(stream: &'a [ImuSample], imu: &'a [ImuSample], end_ns: i64) -> &'a [ImuSample] {
    let Some(first) = imu.first() else { return imu };
    let start = stream.partition_point(|sample| sample.stamp_ns < first.stamp_ns);
    let end = (stream.partition_point(|sample| sample.stamp_ns < end_ns) + 1).min(stream.len());
    stream.get(start..end.max(start + imu.len())).unwrap_or(imu)
}

//! One simulated walk: world, trajectory and sensors put together, frame by frame.

use std::sync::Arc;

use evac_formats::wt901c::Scales;
use evac_frames::{FrameHeader, ImuSample, Point, PoseFrame, ScanHeader, TrackingState, frame_flags};
use evac_geometry::nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use evac_geometry::{STANDARD_GRAVITY, set_map_from_imu, set_map_from_lidar};
use evac_stage::{Rig, ScanWithImu, StageConfig as _, StageError};

use crate::config::Config;
use crate::mid40::{Mid40, SHOTS_PER_FRAME};
use crate::random::Random;
use crate::trajectory::{Gait, Trajectory};
use crate::world::{Ray, World};
use crate::wt901c::Wt901c;

/// Length of a frame, nanoseconds.
pub const FRAME_NS: i64 = 100_000_000;

/// One IMU sample, in SI units and as the device's words.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sampled {
    pub(crate) sample: ImuSample,
    pub(crate) accel: [i16; 3],
    pub(crate) gyro: [i16; 3],
}

/// The walk as its sensors see it. IMU samples and scans are drawn one after the other, independently.
#[derive(Debug, Clone)]
pub struct Walk {
    world: Arc<World>,
    trajectory: Trajectory,
    imu_from_lidar: Isometry3<f64>,
    map_from_world: Isometry3<f64>,
    frames: u64,
    clock_offset_ns: f64,
    clock_rate: f64,
    sample_ns: i64,
    lidar: Mid40,
    imu: Wt901c,
    next_frame: u64,
    next_sample: u64,
}

impl Walk {
    /// Builds the world and puts the walker at its start.
    ///
    /// # Errors
    /// [`StageError::Config`] for a value out of range, [`StageError::File`] for a cloud that cannot be read.
    pub fn new(config: &Config, rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        let (world, route) = World::build(config)?;
        let gait = Gait::new(config.gait, &mut Random::new(config.seed, 0));
        let skipped = if config.start_walking { route.stride_s() } else { 0.0 };
        let tilt = config.mount_tilt_deg.map(f64::to_radians);
        let trajectory = Trajectory::new(route, gait, tilt).without_first(skipped);
        let duration = config.duration_s.unwrap_or(f64::INFINITY).min(trajectory.duration_s());
        let frames = (duration * 1e9 / FRAME_NS as f64 + 1e-6).floor() as u64;
        let imu_from_lidar = rig.imu_from_lidar();
        let world_from_lidar = trajectory.at(FRAME_NS as f64 * 1e-9).world_from_imu * imu_from_lidar;
        Ok(Self {
            map_from_world: level(&world_from_lidar).inverse(),
            lidar: Mid40::new(config, Random::new(config.seed, 1)),
            imu: Wt901c::new(config, Random::new(config.seed, 2)),
            clock_offset_ns: config.imu_clock_offset_ms * 1e6,
            clock_rate: 1.0 + config.imu_clock_ppm * 1e-6,
            sample_ns: config.sample_ns(),
            world: Arc::new(world),
            trajectory,
            imu_from_lidar,
            frames,
            next_frame: 0,
            next_sample: 0,
        })
    }

    /// Scans in the whole walk.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Sensor time at which the walk ends, nanoseconds.
    pub fn end_ns(&self) -> i64 {
        self.frames as i64 * FRAME_NS
    }

    /// Stamp of the next IMU sample, nanoseconds; `None` after the last, which is at the end of the last scan.
    pub(crate) fn next_imu_ns(&self) -> Option<i64> {
        let stamp = self.next_sample as i64 * self.sample_ns;
        (stamp <= self.end_ns()).then_some(stamp)
    }

    /// The next IMU sample.
    pub(crate) fn next_imu(&mut self) -> Option<Sampled> {
        let stamp_ns = self.next_imu_ns()?;
        // The stamp is the IMU's own clock: offset and rate tell what time it really was.
        let time_ns = (stamp_ns as f64 - self.clock_offset_ns) / self.clock_rate;
        let (accel, gyro) = self.imu.measure(&self.trajectory.at(time_ns * 1e-9));
        let scales = Scales::default();
        let sample = ImuSample {
            seq: self.next_sample,
            stamp_ns,
            gyro: scales.gyro(gyro),
            accel: scales.accel(accel),
            flags: if stamp_ns + self.sample_ns > self.end_ns() { frame_flags::END_OF_STREAM } else { 0 },
            ..ImuSample::default()
        };
        self.next_sample += 1;
        Some(Sampled { sample, accel, gyro })
    }

    /// End of the next scan, nanoseconds; `None` after the last.
    pub(crate) fn next_scan_ns(&self) -> Option<i64> {
        (self.next_frame < self.frames).then_some((self.next_frame as i64 + 1) * FRAME_NS)
    }

    /// The next scan into `points`, with the truth at its end.
    pub(crate) fn next_scan(&mut self, points: &mut Vec<Point>) -> Option<(ScanHeader, PoseFrame)> {
        let end_ns = self.next_scan_ns()?;
        let (trajectory, imu_from_lidar) = (&self.trajectory, self.imu_from_lidar);
        let world_from_lidar = |t: f64| trajectory.at(t).world_from_imu * imu_from_lidar;
        self.lidar.scan(self.next_frame, &self.world, world_from_lidar, points);
        let last = self.next_frame + 1 == self.frames;
        let frame = FrameHeader {
            seq: self.next_frame,
            start_ns: end_ns - FRAME_NS,
            end_ns,
            flags: if last { frame_flags::END_OF_STREAM } else { 0 },
            ..FrameHeader::default()
        };
        let header = ScanHeader {
            frame,
            points: points.len() as u32,
            no_return: points.iter().filter(|point| !point.is_return()).count() as u32,
            ..ScanHeader::default()
        };
        self.next_frame += 1;
        Some((header, self.truth(frame)))
    }

    /// Leaves the next scan out; those after it are as they would have been.
    pub(crate) fn pass_over_scan(&mut self) -> Option<ScanHeader> {
        let end_ns = self.next_scan_ns()?;
        self.lidar.pass_over();
        let frame = FrameHeader {
            seq: self.next_frame,
            start_ns: end_ns - FRAME_NS,
            end_ns,
            ..FrameHeader::default()
        };
        self.next_frame += 1;
        Some(ScanHeader { frame, ..ScanHeader::default() })
    }

    /// The true pose of the LiDAR in the map frame at a sensor time in nanoseconds.
    pub fn map_from_lidar(&self, time_ns: i64) -> Isometry3<f64> {
        self.map_from_world * self.trajectory.at(time_ns as f64 * 1e-9).world_from_imu * self.imu_from_lidar
    }

    /// Where a ray that leaves the LiDAR along `direction` (unit vector, LiDAR frame) at a sensor time in nanoseconds first
    /// meets the building within `limit_m` metres, in the map frame: for sensors that are not simulated. Exact, without
    /// noise and without people.
    pub fn cast(&self, time_ns: i64, direction: &Vector3<f64>, limit_m: f64) -> Option<Point3<f64>> {
        let world_from_lidar = self.trajectory.at(time_ns as f64 * 1e-9).world_from_imu * self.imu_from_lidar;
        let ray = Ray::new(world_from_lidar.translation.vector, world_from_lidar * direction);
        let (range, _) = self.world.cast(&ray, &[], limit_m)?;
        Some(self.map_from_world * Point3::from(ray.origin + ray.direction * range))
    }

    /// Whether a place in the map frame lies within a body of the building: for outlines that plans are compared with. Without
    /// people, and without the rock of tunnels.
    pub fn is_solid(&self, place: &Point3<f64>) -> bool {
        self.world.is_solid(&(self.map_from_world.inverse() * place).coords)
    }

    /// What the IMU's own clock shows at a sensor time, both in nanoseconds.
    fn imu_stamp(&self, time_ns: f64) -> f64 {
        time_ns * self.clock_rate + self.clock_offset_ns
    }

    fn truth(&self, frame: FrameHeader) -> PoseFrame {
        let time_ns = frame.end_ns as f64;
        let motion = self.trajectory.at(time_ns * 1e-9);
        let map_from_imu = self.map_from_world * motion.world_from_imu;
        let mut truth = PoseFrame {
            frame,
            velocity: (self.map_from_world.rotation * motion.velocity).into(),
            gyro_bias: self.imu.gyro_bias.into(),
            accel_bias: self.imu.accel_bias.into(),
            gravity: [0.0, 0.0, -STANDARD_GRAVITY],
            time_offset_ns: -(self.imu_stamp(time_ns) - time_ns).round() as i64,
            quality: 1.0,
            state: TrackingState::Tracking as u32,
            ..PoseFrame::default()
        };
        set_map_from_imu(&mut truth, &map_from_imu);
        set_map_from_lidar(&mut truth, &(map_from_imu * self.imu_from_lidar));
        truth
    }
}

/// A level frame at the LiDAR's place, its x axis below the LiDAR's: the map frame, seen from the world.
fn level(world_from_lidar: &Isometry3<f64>) -> Isometry3<f64> {
    let forward = world_from_lidar.rotation * Vector3::x();
    let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), forward.y.atan2(forward.x));
    Isometry3::from_parts(Translation3::from(world_from_lidar.translation.vector), yaw)
}

/// One frame of a walk with everything that belongs to it, for tests and benches.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Header of the scan, `seq` counting from 0.
    pub header: ScanHeader,
    /// All 10,000 shots, those without return at the origin.
    pub points: Vec<Point>,
    /// IMU samples from the last one at or before the previous frame's end (on the first frame: all) to the first one at
    /// or after this frame's end.
    pub imu: Vec<ImuSample>,
    /// Truth at the scan's end.
    pub truth: PoseFrame,
}

impl Frame {
    /// The frame as a stage gets it.
    pub fn input<'a>(&'a self, prior: Option<&'a PoseFrame>) -> ScanWithImu<'a> {
        ScanWithImu { header: &self.header, points: &self.points, imu: &self.imu, imu_covers: true, prior }
    }
}

/// The frames of a walk, one after the other.
#[derive(Debug, Clone)]
pub struct Frames {
    walk: Walk,
    border: Option<ImuSample>,
}

impl Frames {
    /// The walk that the frames are drawn from.
    pub fn walk(&self) -> &Walk {
        &self.walk
    }
}

impl Iterator for Frames {
    type Item = Frame;

    fn next(&mut self) -> Option<Frame> {
        let end_ns = self.walk.next_scan_ns()?;
        let mut imu = Vec::with_capacity(24);
        imu.extend(self.border);
        while self.walk.next_imu_ns().is_some_and(|stamp| stamp <= end_ns) {
            imu.extend(self.walk.next_imu().map(|sampled| sampled.sample));
        }
        // 100 ms are whole sample periods: the last sample lies on the border exactly.
        self.border = imu.last().copied();
        let mut points = Vec::with_capacity(SHOTS_PER_FRAME);
        let (header, truth) = self.walk.next_scan(&mut points)?;
        Some(Frame { header, points, imu, truth })
    }
}

/// Walks in memory: an iterator over frames, without processes, files or shared memory.
///
/// # Errors
/// As [`Walk::new`].
pub fn simulate(config: &Config, rig: &Rig) -> Result<Frames, StageError> {
    Ok(Frames { walk: Walk::new(config, rig)?, border: None })
}

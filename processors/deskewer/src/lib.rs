//! Stage `deskewer`: `lidar/scan` + `imu/sample` (+ `odometry/pose` as motion prior) -> `scan/deskewed`, the paper's section 2.2.
//!
//! A scan takes 100 ms, in which a turning rig smears far walls over more than a metre. For each scan the deskewer takes
//! gravity off the accelerations and integrates angular velocity and acceleration over the frame (Algorithm 1, Eq. 4-5), then
//! takes every point from the LiDAR's pose at its own time to the pose at the frame's END (Eq. 6). Points keep their
//! order, time and reflectivity; shots without return, values that are not finite and ranges out of bounds are dropped
//! and counted.
//!
//! Where the IMU does not cover a scan the points pass as they came, the header says `IMU_MISSING` and not
//! `DESKEWED`, and the frame counts as degraded. A scan is never deskewed in part: a cloud in two frames of reference helps nobody.
//! With `enabled = false` all scans pass that way, as wanted and so without a complaint.

mod back_projection;
mod config;
mod motion;

use evac_frames::{Point, ScanHeader, scan_flags};
use evac_geometry::nalgebra::Isometry3;
use evac_stage::{Counters, Readiness, Rig, Routed, ScanOutput, ScanWithImu, Stage, StageConfig, StageError};

use crate::back_projection::BackProjection;
pub use crate::config::DeskewerConfig;
use crate::motion::Motion;

/// The stage.
#[derive(Debug)]
pub struct Deskewer {
    enabled: bool,
    imu_from_lidar: Isometry3<f64>,
    window: RangeWindow,
    motion: Motion,
    back_projection: BackProjection,
}

/// A scan ready to be written: its points are computed as they are asked for, so that they can go straight into shared memory.
#[derive(Debug)]
pub struct DeskewedScan<'a> {
    header: ScanHeader,
    points: &'a [Point],
    window: RangeWindow,
    /// `None` passes points on unchanged.
    back_projection: Option<&'a BackProjection>,
}

impl Deskewer {
    /// Works out the motion over one scan; allocates nothing.
    pub fn deskew<'a>(&'a mut self, input: &ScanWithImu<'a>, counters: &mut Counters) -> DeskewedScan<'a> {
        let mut header = *input.header;
        let window = self.window;
        let tally = window.tally(input.points);
        // A producer may have counted the shots without return that it left in the scan.
        header.no_return = header.no_return.max(tally.no_return);
        header.rejected = header.rejected.saturating_add(tally.rejected);
        header.points = tally.kept;
        let time_offset_ns = input.prior.map_or(self.motion.time_offset_ns(), |pose| pose.time_offset_ns);
        header.time_offset_us = i32::try_from(time_offset_ns / 1000).unwrap_or_default();
        counters.rejected += u64::from(tally.rejected);

        let enabled = self.enabled;
        let back_projection = self.back_projection_for(input);
        let was_deskewed = header.scan_flags & scan_flags::DESKEWED != 0;
        match &back_projection {
            _ if was_deskewed => {}
            Some(_) => header.scan_flags |= scan_flags::DESKEWED,
            None if !enabled => {}
            None => {
                header.scan_flags |= scan_flags::IMU_MISSING;
                counters.degraded += 1;
            }
        }
        let back_projection = back_projection.filter(|_| !was_deskewed);
        DeskewedScan { header, points: input.points, window, back_projection }
    }

    fn back_projection_for(&mut self, input: &ScanWithImu<'_>) -> Option<&BackProjection> {
        if !self.enabled {
            return None;
        }
        let motion = self.motion.follow(input)?;
        let frame = &input.header.frame;
        self.back_projection.tabulate(motion, &self.imu_from_lidar, frame.start_ns, frame.end_ns);
        Some(&self.back_projection)
    }
}

impl Stage for Deskewer {
    const NAME: &'static str = "deskewer";
    type Config = DeskewerConfig;
    type Input<'a> = ScanWithImu<'a>;
    type Output = ScanOutput;

    fn new(config: DeskewerConfig, rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        let imu_from_lidar = rig.imu_from_lidar();
        if !imu_from_lidar.to_homogeneous().iter().all(|value| value.is_finite()) {
            return Err(StageError::Config(
                "[rig.imu_from_lidar] holds a value that is not finite; give metres and degrees".into(),
            ));
        }
        Ok(Self {
            enabled: config.enabled,
            imu_from_lidar,
            window: RangeWindow::new(&config),
            motion: Motion::new(config),
            back_projection: BackProjection::new(),
        })
    }

    fn process(
        &mut self,
        input: ScanWithImu<'_>,
        output: &mut ScanOutput,
        counters: &mut Counters,
    ) -> Result<(), StageError> {
        let scan = self.deskew(&input, counters);
        let mut points = scan.points();
        output.publish(scan.header(), scan.len(), |_| points.next().unwrap_or_default())
    }

    /// Ready when it has followed the motion over a whole scan: pose, biases and the clocks' offset come with the routed pose.
    fn follow(
        &mut self,
        input: ScanWithImu<'_>,
        _routed: Option<Routed<'_, ScanOutput>>,
    ) -> Result<Readiness, StageError> {
        let covered = self.back_projection_for(&input).is_some() || !self.enabled;
        Ok(if covered { Readiness::Ready } else { Readiness::Following })
    }
}

impl DeskewedScan<'_> {
    /// Header with flags and counts set; `points` is [`Self::len`].
    pub fn header(&self) -> &ScanHeader {
        &self.header
    }

    /// Points that remain.
    pub fn len(&self) -> usize {
        self.header.points as usize
    }

    /// Whether no point remains.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The remaining points in their order, in the LiDAR frame at the scan's end (as they came where the IMU was missing).
    pub fn points(&self) -> impl Iterator<Item = Point> + '_ {
        self.points
            .iter()
            .filter(|point| self.window.holds(point))
            .map(|point| self.back_projection.map_or(*point, |table| table.apply(point)))
    }
}

/// Bounds of a believable range.
#[derive(Debug, Clone, Copy)]
struct RangeWindow {
    min_squared: f32,
    max_squared: f32,
}

#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    kept: u32,
    no_return: u32,
    rejected: u32,
}

impl RangeWindow {
    fn new(config: &DeskewerConfig) -> Self {
        let squared = |range: f32| range * range;
        // A shot without return is the origin, which is no point at any minimum.
        Self {
            min_squared: squared(config.min_range_m).max(f32::MIN_POSITIVE),
            max_squared: squared(config.max_range_m),
        }
    }

    /// False for NaN, with which every comparison is, and for infinity.
    #[inline]
    fn holds(&self, point: &Point) -> bool {
        let squared = point.x * point.x + point.y * point.y + point.z * point.z;
        squared >= self.min_squared && squared <= self.max_squared
    }

    fn tally(&self, points: &[Point]) -> Tally {
        let mut tally = Tally::default();
        for point in points {
            let (kept, returned) = (self.holds(point), point.is_return());
            tally.kept += u32::from(kept);
            tally.no_return += u32::from(!returned);
            tally.rejected += u32::from(returned && !kept);
        }
        tally
    }
}

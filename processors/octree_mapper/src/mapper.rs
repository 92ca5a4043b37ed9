//! The stage: filters a scan, inserts it when it is a key frame, and says what changed.

use evac_frames::{MapHeader, PoseFrame, TrackingState, Voxel, map_flags};
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::{Isometry3, Point3};
use evac_octree::{OctreeMap, Scan, ScanOptions};
use evac_stage::{
    Counters, Entry, MapMessage, MapOutput, Readiness, Rig, ScanWithPose, Stage, StageConfig, StageError,
};

use crate::key_frame::KeyFrames;
use crate::unseen::Upkeep;
use crate::{GroundFilter, OctreeMapperConfig, RadiusOutlierFilter};

/// Points a scan that buffers hold from the start: three Mid-40 frames; a larger scan lets them grow once.
const CAPACITY: usize = 30_000;

/// Joins each deskewed scan with its pose; key frames go through the three filters into the octree.
///
/// Every scan gives one update of the same `seq`: the changed voxels of a key frame, nothing otherwise. Scans with a
/// lost, foreign or non-finite pose never enter the map and count as degraded. Of a key frame's points every one is a
/// hit, ground, an outlier, outside or rejected, or it lies beyond `max_range_m` and only clears.
#[derive(Debug)]
pub struct OctreeMapper {
    pub(crate) config: OctreeMapperConfig,
    map: OctreeMap,
    pub(crate) key_frames: KeyFrames,
    pub(crate) key_frame_count: u64,
    /// Key frames that this instance has inserted or followed.
    pub(crate) seen_key_frames: u64,
    pub(crate) upkeep: Upkeep,
    /// Of the newest update.
    pub(crate) newest: Option<MapHeader>,
    outliers: RadiusOutlierFilter,
    pub(crate) ground: GroundFilter,
    /// Returns in range, LiDAR frame.
    returns: Vec<[f32; 3]>,
    /// Filtered points, map frame; later those that are not ground.
    hits: Vec<[f32; 3]>,
    ground_points: Vec<[f32; 3]>,
}

impl OctreeMapper {
    /// The map so far.
    pub fn map(&self) -> &OctreeMap {
        &self.map
    }

    /// Takes over what another mapper's voxels hold.
    fn apply_all(&mut self, voxels: &[Voxel]) -> Result<(), StageError> {
        voxels.iter().try_for_each(|voxel| {
            self.map.apply(voxel).map_err(|cause| {
                StageError::Config(format!(
                    "the routed mapper's map does not fit into this one: {cause:?}; raise max_map_mib"
                ))
            })
        })
    }

    /// The scan's pose where it may enter the map.
    fn usable_pose(&self, pose: &PoseFrame, counters: &mut Counters) -> Option<Isometry3<f64>> {
        let finite = pose.position.iter().chain(&pose.orientation).all(|x| x.is_finite());
        match pose.tracking_state() {
            Some(TrackingState::Tracking | TrackingState::Degenerate) if finite => Some(map_from_lidar(pose)),
            Some(TrackingState::Initialising) if finite => {
                self.config.map_while_initialising.then(|| map_from_lidar(pose))
            }
            _ => {
                counters.degraded += 1;
                None
            }
        }
    }

    /// Filters the scan and inserts it, counting what goes where.
    fn insert(
        &mut self,
        input: &ScanWithPose<'_>,
        map_from_lidar: &Isometry3<f64>,
        header: &mut MapHeader,
        counters: &mut Counters,
    ) {
        self.filter(input, map_from_lidar, header);
        let origin = map_from_lidar.translation.vector;
        let scan = Scan {
            origin: [origin.x as f32, origin.y as f32, origin.z as f32],
            hits: &self.hits,
            ground: &self.ground_points,
            misses: &[],
        };
        let options = ScanOptions {
            max_range: Some(self.config.max_range_m),
            coarse_free_space: self.config.coarse_free_space,
            ..ScanOptions::default()
        };
        let report = self.map.insert_scan(&scan, &options);
        header.hits = report.hits;
        header.ground = report.ground;
        header.rejected += report.not_finite + report.outside;
        counters.rejected += u64::from(header.rejected);
        // The map is full: this scan is in it only in part.
        counters.degraded += u64::from(report.refused_bricks > 0);
    }

    /// The paper's three filters (section 3.1), in its order.
    fn filter(&mut self, input: &ScanWithPose<'_>, map_from_lidar: &Isometry3<f64>, header: &mut MapHeader) {
        self.returns.clear();
        for point in input.points {
            let range = (point.x * point.x + point.y * point.y + point.z * point.z).sqrt();
            if !range.is_finite() || !point.is_return() {
                header.rejected += 1;
            } else if !self.config.bounds.keeps_range(range) {
                header.outside += 1;
            } else {
                self.returns.push([point.x, point.y, point.z]);
            }
        }
        let inliers = self.outliers.inliers(&self.returns);
        self.hits.clear();
        for (point, inlier) in self.returns.iter().zip(inliers) {
            if !inlier {
                header.outliers += 1;
                continue;
            }
            let place = map_from_lidar * Point3::from(point.map(f64::from));
            let place = [place.x as f32, place.y as f32, place.z as f32];
            if self.config.bounds.keeps_place(place) {
                self.hits.push(place);
            } else {
                header.outside += 1;
            }
        }
        let ground = self.ground.ground_of_scan(&self.hits, map_from_lidar.translation.vector.into());
        self.ground_points.clear();
        self.ground_points
            .extend(self.hits.iter().zip(ground).filter(|(_, ground)| **ground).map(|(p, _)| *p));
        let mut flags = ground.iter();
        self.hits.retain(|_| flags.next() == Some(&false));
    }
}

impl Stage for OctreeMapper {
    const NAME: &'static str = "octree_mapper";
    const JOURNALED: bool = true;
    type Config = OctreeMapperConfig;
    type Input<'a> = ScanWithPose<'a>;
    type Output = MapOutput;

    fn new(config: Self::Config, _rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        let map_config = config.map_config().map_err(StageError::Config)?;
        Ok(Self {
            map: OctreeMap::new(map_config).map_err(|e| StageError::Config(e.to_string()))?,
            key_frames: KeyFrames::new(config.key_frames),
            key_frame_count: 0,
            seen_key_frames: 0,
            upkeep: Upkeep::default(),
            newest: None,
            outliers: RadiusOutlierFilter::new(config.outliers, CAPACITY),
            ground: GroundFilter::new(config.ground, CAPACITY),
            returns: Vec::with_capacity(CAPACITY),
            hits: Vec::with_capacity(CAPACITY),
            ground_points: Vec::with_capacity(CAPACITY),
            config,
        })
    }

    fn process(
        &mut self,
        input: ScanWithPose<'_>,
        output: &mut MapOutput,
        counters: &mut Counters,
    ) -> Result<(), StageError> {
        let mut header = MapHeader {
            frame: input.header.frame,
            resolution: self.config.resolution_m,
            position: input.pose.position.map(|x| if x.is_finite() { x } else { 0.0 }),
            ..MapHeader::default()
        };
        let pose = self.usable_pose(input.pose, counters);
        let end_ns = input.header.frame.end_ns;
        let key_pose = pose.filter(|pose| self.key_frames.choose(end_ns, pose));
        if let Some(map_from_lidar) = key_pose {
            self.upkeep.tend(&mut self.map, &self.config.unseen);
            self.insert(&input, &map_from_lidar, &mut header, counters);
            self.key_frame_count += 1;
            self.seen_key_frames += 1;
            header.map_flags = map_flags::KEY_FRAME;
        }
        header.key_frames = self.key_frame_count;
        // What was forgotten before the scan comes before what the scan has changed.
        let aged = if key_pose.is_some() { self.upkeep.changed.as_slice() } else { &[] };
        let scanned = key_pose.map_or(0, |_| self.map.changed());
        let mut changes = aged.iter().copied().chain(self.map.changes());
        output.publish(&header, aged.len() + scanned, |_| changes.next().unwrap_or_default())?;
        self.newest = Some(header);
        self.serve(output)
    }

    /// Takes the voxels over as they are, and comes to the same choice of key frames and the same memory of the ground.
    ///
    /// Ready when that memory is complete: after 16 patches of ground, or if it has followed since the first key frame.
    fn follow(
        &mut self,
        input: ScanWithPose<'_>,
        routed: Option<MapMessage<'_>>,
    ) -> Result<Readiness, StageError> {
        let Some(update) = routed else { return Ok(Readiness::Following) };
        if update.header.map_flags & map_flags::KEY_FRAME != 0
            && let Some(pose) = self.usable_pose(input.pose, &mut Counters::default())
        {
            self.key_frames.adopt(input.header.frame.end_ns, &pose);
            self.filter(&input, &pose, &mut MapHeader::default());
            self.seen_key_frames += 1;
        }
        self.adopt(update)?;
        let is_complete = self.seen_key_frames == self.key_frame_count;
        let is_ready = self.seen_key_frames > 0 && (self.ground.is_warm() || is_complete);
        Ok(if is_ready { Readiness::Ready } else { Readiness::Following })
    }

    fn adopt(&mut self, routed: MapMessage<'_>) -> Result<(), StageError> {
        let header = routed.header;
        if header.resolution != self.config.resolution_m {
            return Err(StageError::Config(format!(
                "resolution_m = {} does not continue the map of the routed mapper, which has {} m; use the same, or stop the pipeline first",
                self.config.resolution_m, header.resolution
            )));
        }
        if header.map_flags & map_flags::SNAPSHOT != 0 {
            let config = self.config.map_config().map_err(StageError::Config)?;
            self.map = OctreeMap::new(config).map_err(|e| StageError::Config(e.to_string()))?;
            self.seen_key_frames = 0;
        }
        self.apply_all(routed.voxels)?;
        self.key_frame_count = header.key_frames;
        self.newest = Some(MapHeader { map_flags: 0, ..*header });
        Ok(())
    }

    fn write_down(&mut self, entry: &mut Entry, whole: bool) {
        self.save_memory(&mut entry.now);
        let is_key_frame = self.newest.is_some_and(|newest| newest.map_flags & map_flags::KEY_FRAME != 0);
        if whole {
            entry.voxels.extend(self.map.voxels());
        } else if is_key_frame {
            entry.voxels.extend_from_slice(&self.upkeep.changed);
            entry.voxels.extend(self.map.changes());
        }
    }

    /// With the voxels, the choice of key frames and the memory of the ground as they were, the next scan is inserted as it would
    /// have been.
    fn read_back(&mut self, entry: &mut Entry) -> Result<(), StageError> {
        self.apply_all(&entry.voxels)?;
        if entry.now.is_at_end() { Ok(()) } else { self.load_memory(&mut entry.now) }
    }

    /// Publishes the map for a reader that asks for it, from the first scan on.
    fn serve(&mut self, output: &mut MapOutput) -> Result<(), StageError> {
        let Some(newest) = self.newest else { return Ok(()) };
        if !output.snapshot_requested() {
            return Ok(());
        }
        let header = MapHeader { map_flags: map_flags::SNAPSHOT, ..newest };
        let mut voxels = self.map.voxels();
        output.publish_snapshot(&header, self.map.voxel_count(), |_| voxels.next().unwrap_or_default())
    }
}

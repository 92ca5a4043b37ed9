//! Stage `map_saver`: what remains of a walk.
//!
//! It keeps the octree from `map/update`, the poses, and one point for each cell of the deskewed scans, and writes at the
//! end of the stream, on SIGTERM and at a configured interval of sensor time, each file whole or not at all:
//!
//! - `map.ot`, `map.bt`: the mapper's octree as OctoMap's files;
//! - `trajectory.tum`: the LiDAR's pose in the map frame at each frame's end, sensor time; `truth.tum` the same from a
//!   simulator, where one runs;
//! - `cloud.pcd`: the thinned cloud in the map frame, binary, with intensity.
//!
//! The same frames give the same bytes.

mod config;
mod thinned_cloud;

use std::fs;

use evac_formats::cloud::{CloudPoint, Intensity};
use evac_formats::tum::TumPose;
use evac_formats::{FormatError, octomap, pcd, tum};
use evac_frames::{Ack, MapHeader, PoseFrame, TrackingState, frame_flags, map_flags};
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::Point3;
use evac_octree::{MapConfig, MapError, OctreeMap, Pruning, SensorModel};
use evac_stage::{
    Counters, Entry, NoOutput, Readiness, Rig, SinkInput, Stage, StageConfig, StageError, State,
};

pub use config::MapSaverConfig;

use crate::thinned_cloud::{Dropped, ThinnedCloud};

/// How far a quaternion's norm may be from 1.
const NORM_TOLERANCE: f64 = 1e-3;

/// The stage.
pub struct MapSaver {
    config: MapSaverConfig,
    sensor: SensorModel,
    map: Option<OctreeMap>,
    trajectory: Vec<TumPose>,
    truth: Vec<TumPose>,
    cloud: ThinnedCloud,
    saved_ns: Option<i64>,
    /// Something came after the last saving.
    unsaved: bool,
    /// A standby's: up to this frame all but the map comes from the saver that leads.
    loaded_seq: Option<u64>,
    /// Poses, true poses and points that are in the journal.
    written: [usize; 3],
}

impl Stage for MapSaver {
    const NAME: &'static str = "map_saver";
    const JOURNALED: bool = true;
    type Config = MapSaverConfig;
    type Input<'a> = SinkInput<'a>;
    type Output = NoOutput;

    fn new(config: Self::Config, _rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        fs::create_dir_all(&config.output_dir)
            .map_err(|cause| file_error(FormatError::writing(&config.output_dir, cause)))?;
        let p = config.occupied_probability;
        let sensor = SensorModel { occupied: (p / (1.0 - p)).ln() as f32, ..SensorModel::default() };
        Ok(Self {
            sensor,
            map: None,
            trajectory: Vec::new(),
            truth: Vec::new(),
            cloud: ThinnedCloud::new(config.cloud_voxel_m, config.max_cloud_points),
            saved_ns: None,
            unsaved: false,
            loaded_seq: None,
            written: [0; 3],
            config,
        })
    }

    fn process(
        &mut self,
        input: SinkInput<'_>,
        _output: &mut NoOutput,
        counters: &mut Counters,
    ) -> Result<(), StageError> {
        self.gather(&input, counters)?;
        let frame = &input.map.header.frame;
        if frame.flags & frame_flags::END_OF_STREAM != 0 || self.is_due(frame.end_ns) {
            self.save()?;
        }
        Ok(())
    }

    /// Gathers the same and writes nothing.
    fn follow(&mut self, input: SinkInput<'_>, _done: Option<&Ack>) -> Result<Readiness, StageError> {
        let counters = &mut Counters::default();
        if self.loaded_seq.is_some_and(|loaded| input.map.header.frame.seq <= loaded) {
            self.add_voxels(&input, counters)?;
        } else {
            self.gather(&input, counters)?;
        }
        Ok(if self.loaded_seq.is_some() { Readiness::Ready } else { Readiness::Following })
    }

    fn save_state(&self, state: &mut State) {
        self.save_after([0; 3], state);
    }

    fn load_state(&mut self, state: &mut State, seq: u64) -> Result<(), StageError> {
        self.trajectory.clear();
        self.truth.clear();
        self.cloud = ThinnedCloud::new(self.config.cloud_voxel_m, self.config.max_cloud_points);
        self.load_more(state)?;
        (self.loaded_seq, self.unsaved) = (Some(seq), true);
        Ok(())
    }

    /// The map is not in it: the mapper gives it to whoever asks.
    fn write_down(&mut self, entry: &mut Entry, whole: bool) {
        self.save_after(if whole { [0; 3] } else { self.written }, &mut entry.added);
        self.written = self.gathered();
    }

    fn read_back(&mut self, entry: &mut Entry) -> Result<(), StageError> {
        while !entry.added.is_at_end() {
            self.load_more(&mut entry.added)?;
        }
        (self.written, self.unsaved) = (self.gathered(), true);
        Ok(())
    }

    fn finish(&mut self) -> Result<(), StageError> {
        if self.unsaved { self.save() } else { Ok(()) }
    }
}

impl MapSaver {
    fn gathered(&self) -> [usize; 3] {
        [self.trajectory.len(), self.truth.len(), self.cloud.points().len()]
    }

    /// Poses, true poses and points after the first so many of each.
    fn save_after(&self, [poses, truth, points]: [usize; 3], state: &mut State) {
        for (all, first) in [(&self.trajectory, poses), (&self.truth, truth)] {
            let poses = all.get(first..).unwrap_or_default();
            state.put(poses.len() as u64);
            for TumPose { stamp_ns, position, orientation } in poses {
                state.put(stamp_ns.cast_unsigned());
                state.put_reals(position);
                state.put_reals(orientation);
            }
        }
        let points = self.cloud.points().get(points..).unwrap_or_default();
        state.put(points.len() as u64);
        for point in points {
            state.put_reals(&[point.x, point.y, point.z, point.intensity].map(f64::from));
        }
    }

    fn load_more(&mut self, state: &mut State) -> Result<(), StageError> {
        for poses in [&mut self.trajectory, &mut self.truth] {
            for _ in 0..state.number()? {
                let stamp_ns = state.number()?.cast_signed();
                poses.push(TumPose { stamp_ns, position: state.reals()?, orientation: state.reals()? });
            }
        }
        for _ in 0..state.number()? {
            let [x, y, z, intensity] = state.reals()?.map(|number| number as f32);
            // Another cell size or limit thins them again.
            let _ = self.cloud.insert(CloudPoint { x, y, z, intensity });
        }
        Ok(())
    }

    fn gather(&mut self, input: &SinkInput<'_>, counters: &mut Counters) -> Result<(), StageError> {
        self.add_voxels(input, counters)?;
        self.add_points(input, counters);
        self.add_poses(input, counters);
        self.unsaved = true;
        Ok(())
    }

    fn add_voxels(&mut self, input: &SinkInput<'_>, counters: &mut Counters) -> Result<(), StageError> {
        let header = input.map.header;
        let map = match &mut self.map {
            Some(map) if header.map_flags & map_flags::SNAPSHOT == 0 => map,
            other => other.insert(new_map(header, self.sensor, self.config.max_map_mib)?),
        };
        if map.space().resolution() != header.resolution {
            // Updates of another resolution belong to a map whose beginning is not known here.
            counters.degraded += 1;
            return Ok(());
        }
        let refused = input.map.voxels.iter().filter(|voxel| map.apply(voxel).is_err()).count();
        counters.rejected += refused as u64;
        Ok(())
    }

    /// Scans of an odometry that still looks for gravity have no pose yet, and those of a lost one a wrong pose.
    fn add_points(&mut self, input: &SinkInput<'_>, counters: &mut Counters) {
        match input.pose.tracking_state() {
            Some(TrackingState::Tracking | TrackingState::Degenerate) if is_pose(input.pose) => {}
            Some(TrackingState::Initialising) => return,
            _ => {
                counters.degraded += 1;
                return;
            }
        }
        let map_from_lidar = map_from_lidar(input.pose);
        for point in input.points {
            let in_map = map_from_lidar * Point3::new(point.x, point.y, point.z).cast::<f64>();
            let in_map = in_map.cast::<f32>();
            let intensity = f32::from(point.reflectivity());
            let point = CloudPoint { x: in_map.x, y: in_map.y, z: in_map.z, intensity };
            counters.rejected += u64::from(self.cloud.insert(point) == Err(Dropped::Rejected));
        }
    }

    /// A snapshot stands for frames that were missed, and the pose that comes with it may hold a position only.
    fn add_poses(&mut self, input: &SinkInput<'_>, counters: &mut Counters) {
        if input.map.header.map_flags & map_flags::SNAPSHOT != 0 {
            return;
        }
        let max_poses = self.config.max_poses as usize;
        let mut kept = add_pose(&mut self.trajectory, input.pose, max_poses);
        if let Some(truth) = input.truth {
            kept &= add_pose(&mut self.truth, truth, max_poses);
        }
        counters.degraded += u64::from(!kept);
    }

    /// Whether the interval of sensor time has passed since the last saving, at first since the first frame.
    fn is_due(&mut self, now_ns: i64) -> bool {
        let since = *self.saved_ns.get_or_insert(now_ns);
        let interval_ns = (self.config.save_interval_s * 1e9) as i64;
        let due = interval_ns > 0 && now_ns.saturating_sub(since) >= interval_ns;
        if due || now_ns < since {
            self.saved_ns = Some(now_ns);
        }
        due
    }

    fn save(&mut self) -> Result<(), StageError> {
        self.write_files().map_err(file_error)?;
        self.unsaved = false;
        Ok(())
    }

    fn write_files(&self) -> Result<(), FormatError> {
        let path = |name: &str| self.config.output_dir.join(name);
        if let Some(map) = &self.map {
            let tree = map.to_tree(Pruning::Full);
            octomap::write_ot(&path("map.ot"), &tree)?;
            octomap::write_bt(&path("map.bt"), &tree, &map.sensor().binary_values())?;
        }
        tum::write(&path("trajectory.tum"), &self.trajectory)?;
        if !self.truth.is_empty() {
            tum::write(&path("truth.tum"), &self.truth)?;
        }
        let points = self.cloud.points().iter().copied();
        pcd::write(&path("cloud.pcd"), points, Intensity::Kept, pcd::WriteAs::Binary)
    }
}

fn new_map(header: &MapHeader, sensor: SensorModel, max_map_mib: f64) -> Result<OctreeMap, StageError> {
    let max_bytes = (max_map_mib * f64::from(1 << 20)) as usize;
    let config = MapConfig { sensor, max_bytes, ..MapConfig::new(header.resolution) };
    OctreeMap::new(config).map_err(|cause: MapError| StageError::Config(format!("map/update: {cause}")))
}

/// Keeps a pose; false where it is none or there are too many.
fn add_pose(poses: &mut Vec<TumPose>, pose: &PoseFrame, max_poses: usize) -> bool {
    let keep = poses.len() < max_poses && is_pose(pose);
    if keep {
        let PoseFrame { frame, position, orientation, .. } = *pose;
        poses.push(TumPose { stamp_ns: frame.end_ns, position, orientation });
    }
    keep
}

/// Whether the numbers are finite and the quaternion is a rotation.
fn is_pose(pose: &PoseFrame) -> bool {
    let norm = pose.orientation.iter().map(|q| q * q).sum::<f64>().sqrt();
    pose.position.iter().all(|axis| axis.is_finite()) && (norm - 1.0).abs() <= NORM_TOLERANCE
}

fn file_error(error: FormatError) -> StageError {
    StageError::File(error.to_string())
}

#[cfg(test)]
mod tests;

//! What the mapper remembers beside its voxels, for its journal: with it the next scan goes into the map as it would have.

use evac_frames::{FrameHeader, MapHeader};
use evac_geometry::nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use evac_stage::{StageError, State};

use crate::mapper::OctreeMapper;

impl OctreeMapper {
    pub(crate) fn save_memory(&self, state: &mut State) {
        state.put_reals(&[self.config.resolution_m]);
        for count in [self.key_frame_count, self.seen_key_frames, u64::from(self.upkeep.key_frames)] {
            state.put(count);
        }
        let newest = self.newest.unwrap_or_default();
        let FrameHeader { seq, start_ns, end_ns, arrival_ns, sent_ns, flags, .. } = newest.frame;
        state.put(u64::from(self.newest.is_some()));
        state.put(seq);
        [start_ns, end_ns, arrival_ns, sent_ns].iter().for_each(|time| state.put(time.cast_unsigned()));
        state.put(u64::from(flags));
        state.put_reals(&newest.position);
        self.key_frames.save(state);
        self.ground.save(state);
    }

    pub(crate) fn load_memory(&mut self, state: &mut State) -> Result<(), StageError> {
        let [resolution] = state.reals()?;
        if resolution != self.config.resolution_m {
            return Err(StageError::Config(format!(
                "resolution_m = {} does not continue the journal's map, which has {resolution} m; use the same, or stop the pipeline first",
                self.config.resolution_m
            )));
        }
        self.key_frame_count = state.number()?;
        self.seen_key_frames = state.number()?;
        self.upkeep.key_frames = state.number()? as u32;
        let is_known = state.number()? != 0;
        let seq = state.number()?;
        let mut times = [0; 4];
        for time in &mut times {
            *time = state.number()?.cast_signed();
        }
        let [start_ns, end_ns, arrival_ns, sent_ns] = times;
        let flags = state.number()? as u32;
        let frame =
            FrameHeader { seq, start_ns, end_ns, arrival_ns, sent_ns, flags, ..FrameHeader::default() };
        let newest = MapHeader {
            frame,
            resolution,
            position: state.reals()?,
            key_frames: self.key_frame_count,
            ..MapHeader::default()
        };
        self.newest = is_known.then_some(newest);
        self.key_frames.load(state)?;
        self.ground.load(state)
    }
}

/// A pose, bit by bit.
pub(crate) fn save_pose(state: &mut State, pose: &Isometry3<f64>) {
    state.put_reals(pose.translation.vector.as_slice());
    state.put_reals(pose.rotation.coords.as_slice());
}

/// As it was saved.
pub(crate) fn load_pose(state: &mut State) -> Result<Isometry3<f64>, StageError> {
    let [x, y, z] = state.reals()?;
    let [i, j, k, w] = state.reals()?;
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
    Ok(Isometry3::from_parts(Translation3::new(x, y, z), rotation))
}

//! Two maps become one.

use crate::decoded::Decoded;
use crate::directory::Near;
use crate::mask::{self, Mask, WORDS};
use crate::{MapError, OctreeMap, SensorModel};

/// What a merge did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MergeReport {
    /// Voxels of the other map that went in.
    pub voxels: usize,
    /// Bricks of 8 x 8 x 8 voxels that the ceiling kept out.
    pub refused_bricks: u32,
}

impl OctreeMap {
    /// Adds the evidence of another map of the same resolution: each of its voxels is an update by its log-odds, as
    /// OctoMap's `updateNode(key, log_odds)` would make it (sum, clamped; a voxel at its clamp stays). Ground flags are
    /// joined. Where the map is full, new bricks are refused in Morton order and counted.
    ///
    /// # Errors
    /// [`MapError::OtherResolution`]; the map is unchanged.
    pub fn merge(&mut self, other: &Self) -> Result<MergeReport, MapError> {
        let (ours, theirs) = (self.space.resolution(), other.space.resolution());
        if ours != theirs {
            return Err(MapError::OtherResolution { ours, theirs });
        }
        self.revision = self.revision.wrapping_add(1);
        self.marked.clear();
        self.changed = 0;
        let mut report = MergeReport::default();
        let (mut near, mut theirs, mut ours) = (Near::default(), Decoded::default(), Decoded::default());
        let mut groups = Vec::new();
        for (code, from) in other.bricks.sorted() {
            let Some(place) = self.bricks.find_or_add_one(code, &mut near) else {
                report.refused_bricks += 1;
                continue;
            };
            report.voxels += self.merge_brick(other, (from, place), [&mut theirs, &mut ours], &mut groups);
        }
        Ok(report)
    }

    fn merge_brick(
        &mut self,
        other: &Self,
        (from, place): (u32, u32),
        [theirs, ours]: [&mut Decoded; 2],
        groups: &mut Vec<(f32, Mask)>,
    ) -> usize {
        let (known_before, ground_before) = (self.bricks.known(place), self.bricks.ground(place));
        groups.clear();
        let theirs_known = match (other.bricks.uniform(from), self.bricks.uniform(place)) {
            (Some(update), Some(value)) => {
                groups.push((added(&self.sensor, value, update), [u64::MAX; WORDS]));
                [u64::MAX; WORDS]
            }
            _ => {
                other.bricks.decode(from, theirs);
                self.bricks.decode(place, ours);
                for voxel in mask::Bits::of(theirs.known) {
                    let old = ours.value(voxel).unwrap_or(0.0);
                    let new = added(&self.sensor, old, theirs.value(voxel).unwrap_or(0.0));
                    let group = match groups.iter_mut().find(|(value, _)| value.to_bits() == new.to_bits()) {
                        Some((_, mask)) => mask,
                        None => {
                            groups.push((new, [0; WORDS]));
                            let Some((_, mask)) = groups.last_mut() else { continue };
                            mask
                        }
                    };
                    mask::set(group, voxel);
                }
                theirs.known
            }
        };
        for (value, voxels) in groups {
            self.bricks.assign(place, voxels, *value, self.revision);
        }
        let ground = other.bricks.ground(from);
        if !mask::is_empty(&ground) {
            let (store, index) = self.bricks.at_mut(place);
            store.add_ground(index, &ground);
            store.set_revision(index, self.revision);
        }
        for word in 0..WORDS {
            let new = theirs_known[word] & !known_before[word];
            let listed = (theirs_known[word] | ground[word]) & !(known_before[word] | ground_before[word]);
            self.known += new.count_ones() as usize;
            self.listed += listed.count_ones() as usize;
        }
        mask::count(&theirs_known)
    }
}

/// A voxel's value after an update by log-odds.
fn added(sensor: &SensorModel, value: f32, update: f32) -> f32 {
    let stays = update >= 0.0 && value >= sensor.clamp_max || update <= 0.0 && value <= sensor.clamp_min;
    if stays { value } else { sensor.clamped(value + update) }
}

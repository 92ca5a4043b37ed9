//! The marks of a scan become new log-odds.

use crate::bricks::BrickMut;
use crate::map::OctreeMap;
use crate::marks::Marks;
use crate::{ScanReport, SensorModel};

impl OctreeMap {
    /// Updates each marked voxel once, brick by brick in Morton order.
    pub(crate) fn apply_marks(&mut self, report: &mut ScanReport) {
        self.marks.sort();
        self.changed = 0;
        for n in 0..self.marks.len() {
            let Some(marks) = self.marks.sorted_mut(n) else { break };
            let Some(place) = self.bricks.find_or_add(marks.brick) else {
                report.refused_bricks = report.refused_bricks.saturating_add(1);
                continue;
            };
            marks.place = place;
            let sums = update(&self.sensor, &mut self.bricks.get_mut(place), marks);
            report.free_voxels += sums.free;
            report.occupied_voxels += sums.occupied;
            self.known += sums.new as usize;
            self.listed += sums.listed as usize;
            self.changed += sums.changed as usize;
        }
        report.changed = self.changed as u32;
    }
}

#[derive(Default)]
struct Sums {
    free: u32,
    occupied: u32,
    /// Voxels that were unknown.
    new: u32,
    /// Voxels that were unknown and without a flag.
    listed: u32,
    changed: u32,
}

fn update(sensor: &SensorModel, brick: &mut BrickMut<'_>, marks: &mut Marks) -> Sums {
    let mut sums = Sums::default();
    let (words, _) = brick.log_odds.as_chunks_mut::<64>();
    for (word, values) in words.iter_mut().enumerate() {
        let hit = marks.hit[word];
        // A voxel with a point in it is not cleared by the rays that pass it.
        let free = marks.free[word] & !hit;
        if free | hit == 0 {
            // No ground without a free or occupied voxel.
            marks.changed[word] = 0;
            continue;
        }
        let known = brick.known[word];
        let ground = brick.ground[word];
        let (new_known, new_ground) = (known | free | hit, ground | marks.ground[word]);
        let mut changed = new_known & !known | new_ground & !ground;
        changed |= update_word(values, free, |value| sensor.missed(value));
        if hit != 0 {
            changed |= update_word(values, hit, |value| sensor.struck(value));
        }
        brick.known[word] = new_known;
        brick.ground[word] = new_ground;
        marks.changed[word] = changed;
        sums.free += free.count_ones();
        sums.occupied += hit.count_ones();
        sums.new += (new_known & !known).count_ones();
        sums.listed += ((new_known | new_ground) & !(known | ground)).count_ones();
        sums.changed += changed.count_ones();
    }
    sums
}

/// Updates the voxels of `bits` and says which have a new value. An unknown voxel's value is zero, the log-odds of the
/// prior of 0.5.
#[inline]
fn update_word(values: &mut [f32; 64], mut bits: u64, update: impl Fn(f32) -> f32) -> u64 {
    let mut changed = 0;
    while bits != 0 {
        let voxel = bits.trailing_zeros() as usize;
        bits &= bits - 1;
        let value = &mut values[voxel];
        let new = update(*value);
        changed |= u64::from(new != *value) << voxel;
        *value = new;
    }
    changed
}

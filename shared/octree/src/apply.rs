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
        let known = brick.known[word];
        let ground = brick.ground[word];
        let mut changed = marks.ground[word] & !ground;
        if free != 0 {
            changed |= update_word(sensor, values, known, free, sensor.miss);
        }
        if hit != 0 {
            changed |= update_word(sensor, values, known, hit, sensor.hit);
        }
        brick.known[word] |= free | hit;
        brick.ground[word] |= marks.ground[word];
        marks.changed[word] = changed;
        sums.free += free.count_ones();
        sums.occupied += hit.count_ones();
        sums.new += (brick.known[word] & !known).count_ones();
        sums.listed += ((brick.known[word] | brick.ground[word]) & !(known | ground)).count_ones();
        sums.changed += changed.count_ones();
    }
    sums
}

/// Adds `update` to the voxels of `bits` and says which have a new state.
#[inline]
fn update_word(sensor: &SensorModel, values: &mut [f32; 64], known: u64, mut bits: u64, update: f32) -> u64 {
    let first = sensor.first(update);
    let mut changed = bits & !known;
    while bits != 0 {
        let voxel = bits.trailing_zeros() as usize;
        bits &= bits - 1;
        let old = values[voxel];
        let new = if known >> voxel & 1 != 0 { sensor.updated(old, update) } else { first };
        changed |= u64::from(new != old) << voxel;
        values[voxel] = new;
    }
    changed
}

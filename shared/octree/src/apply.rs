//! The marks of a scan become new log-odds.

use crate::ScanReport;
use crate::directory::Near;
use crate::map::OctreeMap;
use crate::store::{BrickMarks, Sums};

impl OctreeMap {
    /// Updates each marked voxel once, brick by brick in Morton order.
    pub(crate) fn apply_marks(&mut self, report: &mut ScanReport) {
        self.marks.sort();
        self.scan = self.scan.wrapping_add(1);
        self.revision = self.revision.wrapping_add(1);
        let mut near = Near::default();
        let mut sums = Sums::default();
        let mut order = std::mem::take(&mut self.marks.order);
        order.retain_mut(|marked| match self.bricks.find_or_add(marked.brick, &mut near) {
            Some(place) => {
                marked.place = place;
                true
            }
            None => {
                report.refused_bricks = report.refused_bricks.saturating_add(1);
                false
            }
        });
        for marked in &order {
            let (free, ends) = self.marks.free_and_ends(marked.slot);
            let marks = BrickMarks { free, ends: ends.map(|ends| (&ends.hit, &ends.ground)) };
            let (store, index) = self.bricks.at_mut(marked.place);
            sums += store.update(index, marks, self.scan, self.revision);
        }
        self.marks.order = order;
        report.free_voxels = sums.free;
        report.occupied_voxels = sums.occupied;
        report.changed = sums.changed;
        self.known += sums.new as usize;
        self.listed += sums.listed as usize;
        self.changed = sums.changed as usize;
    }
}

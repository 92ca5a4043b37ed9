//! What was not seen again fades.

use crate::OctreeMap;
use crate::mask::WORDS;

impl OctreeMap {
    /// Forgets every brick of 8 x 8 x 8 voxels that none of the last `scans` scans has touched, and gives how many voxels
    /// that were. A brick that came in without a scan counts as old as the map. For maps that follow their sensor, and for
    /// places that change while nobody looks; OctoMap has nothing like it.
    pub fn forget_unseen(&mut self, scans: u32) -> usize {
        let old = self.unseen(scans);
        old.into_iter().map(|(code, place)| self.erase(code, place, &[u64::MAX; WORDS])).sum()
    }

    /// Moves the log-odds of every voxel in bricks that none of the last `scans` scans has touched towards zero by `step`
    /// (positive), and forgets the voxels that get there. Gives how many voxels have changed. Called once a second or so
    /// it lets old knowledge fade: both what was free and what was occupied becomes doubtful, then unknown.
    ///
    /// Values keep their place between the clamps, so later scans update them as any other. A `step` that is no positive
    /// number changes nothing.
    pub fn fade_unseen(&mut self, scans: u32, step: f32) -> usize {
        if !(step.is_finite() && step > 0.0) {
            return 0;
        }
        let mut groups = Vec::new();
        let mut faded = 0;
        for (code, place) in self.unseen(scans) {
            groups.clear();
            let (store, index) = self.bricks.at(place);
            store.for_each_value(index, self.bricks.palette(), |word, voxels, value| {
                groups.push((word, voxels, value));
            });
            self.revision = self.revision.wrapping_add(1);
            let mut gone = [0; WORDS];
            for &(word, voxels, value) in &groups {
                faded += voxels.count_ones() as usize;
                if value.abs() <= step {
                    gone[word] |= voxels;
                    continue;
                }
                let mut mask = [0; WORDS];
                mask[word] = voxels;
                self.bricks.assign(place, &mask, value - step.copysign(value), self.revision);
            }
            if gone != [0; WORDS] {
                self.erase(code, place, &gone);
            }
        }
        faded
    }

    /// Codes and places of the bricks that the last `scans` scans have not touched.
    fn unseen(&self, scans: u32) -> Vec<(u64, u32)> {
        let mut bricks = self.bricks.sorted();
        bricks.retain(|&(_, place)| {
            let (store, index) = self.bricks.at(place);
            self.scan.wrapping_sub(store.stamps(index).0) >= scans
        });
        bricks
    }
}

//! What was not seen again fades.

use evac_frames::Voxel;

use crate::OctreeMap;
use crate::mask::{Bits, Mask, WORDS};
use crate::morton::{self, BRICK_BITS};
use crate::voxels::frame;

impl OctreeMap {
    /// Forgets every brick of 8 x 8 x 8 voxels that none of the last `scans` scans has touched, and gives how many voxels
    /// that were. A brick that came in without a scan counts as old as the map. For maps that follow their sensor, and for
    /// places that change while nobody looks; OctoMap has nothing like it.
    pub fn forget_unseen(&mut self, scans: u32) -> usize {
        self.forget_unseen_with(scans, |_| {})
    }

    /// [`Self::forget_unseen`], calling `visit` with every voxel that is gone: without any flag, which is what
    /// [`Self::apply`] in another map takes for it.
    pub fn forget_unseen_with(&mut self, scans: u32, mut visit: impl FnMut(Voxel)) -> usize {
        let mut forgotten = 0;
        for (code, place) in self.unseen(scans) {
            self.visit_gone(code, place, &[u64::MAX; WORDS], &mut visit);
            forgotten += self.erase(code, place, &[u64::MAX; WORDS]);
        }
        forgotten
    }

    /// Moves the log-odds of every voxel in bricks that none of the last `scans` scans has touched towards zero by `step`
    /// (positive), and forgets the voxels that get there. Gives how many voxels have changed. Called once a second or so
    /// it lets old knowledge fade: both what was free and what was occupied becomes doubtful, then unknown.
    ///
    /// Values keep their place between the clamps, so later scans update them as any other. A `step` that is no positive
    /// number changes nothing.
    pub fn fade_unseen(&mut self, scans: u32, step: f32) -> usize {
        self.fade_unseen_with(scans, step, |_| {})
    }

    /// [`Self::fade_unseen`], calling `visit` with every voxel that has changed: with its present state, or without any flag
    /// where it is gone.
    pub fn fade_unseen_with(&mut self, scans: u32, step: f32, mut visit: impl FnMut(Voxel)) -> usize {
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
            let ground = self.bricks.ground(place);
            let mut gone = [0; WORDS];
            for &(word, voxels, value) in &groups {
                faded += voxels.count_ones() as usize;
                if value.abs() <= step {
                    gone[word] |= voxels;
                    continue;
                }
                let mut mask = [0; WORDS];
                mask[word] = voxels;
                let faded = value - step.copysign(value);
                self.bricks.assign(place, &mask, faded, self.revision);
                Bits::of(mask).for_each(|voxel| visit(frame(code, Some(faded), &ground, voxel)));
            }
            self.visit_gone(code, place, &gone, &mut visit);
            if gone != [0; WORDS] {
                self.erase(code, place, &gone);
            }
        }
        faded
    }

    /// Calls `visit` with those of the voxels of a brick that are listed, as gone.
    fn visit_gone(&self, code: u64, place: u32, voxels: &Mask, visit: &mut impl FnMut(Voxel)) {
        let (known, ground) = (self.bricks.known(place), self.bricks.ground(place));
        let listed: Mask = std::array::from_fn(|word| (known[word] | ground[word]) & voxels[word]);
        for voxel in Bits::of(listed) {
            let key = morton::decode(code << BRICK_BITS | voxel as u64);
            visit(Voxel { key, flags: 0, log_odds: 0.0 });
        }
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

//! What has changed since an earlier moment.

use crate::OctreeMap;
use crate::mask::{self, Bits};
use crate::voxels::frame;
use evac_frames::Voxel;

/// A moment in the life of a map; see [`OctreeMap::revision`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Revision(u32);

impl OctreeMap {
    /// The present moment, to be asked about later.
    pub fn revision(&self) -> Revision {
        Revision(self.revision)
    }

    /// Calls `visit` with every voxel, in Morton order, of the bricks of 8 x 8 x 8 that have changed since: all that has
    /// changed, and some that has not. What has not changed costs one comparison a brick.
    ///
    /// `false`, and no call, where voxels were taken out of the map since (deleted, forgotten): then only the whole of
    /// [`Self::voxels`] tells the state.
    pub fn for_each_changed_since(&self, moment: Revision, mut visit: impl FnMut(Voxel)) -> bool {
        let after = |stamp: u32| stamp.wrapping_sub(moment.0) as i32 > 0;
        if after(self.removal) {
            return false;
        }
        for (code, place) in self.bricks.sorted() {
            let (store, index) = self.bricks.at(place);
            if !after(store.stamps(index).1) {
                continue;
            }
            let (known, ground) = (self.bricks.known(place), self.bricks.ground(place));
            let listed: mask::Mask = std::array::from_fn(|word| known[word] | ground[word]);
            for voxel in Bits::of(listed) {
                visit(frame(code, self.bricks.value(place, voxel), &ground, voxel));
            }
        }
        true
    }
}

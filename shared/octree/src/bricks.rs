//! The bricks of a map: a directory over stores that threads can update apart from each other.

use crate::build::Groups;
use crate::directory::{Directory, NOWHERE, Near};
use crate::mask::Mask;
use crate::palette::Palette;
use crate::store::Store;
use crate::{Key, SensorModel};

/// Low bits of a brick's code that choose its store: neighbours along x, y and z are in different ones.
const SHARD_BITS: u32 = 3;

/// Number of stores.
pub(crate) const SHARDS: usize = 1 << SHARD_BITS;

/// Bricks by code (a voxel's Morton code without its last 9 bits). A brick's place never changes; it says which store
/// it is in, and where.
#[derive(Clone, Debug)]
pub(crate) struct Bricks {
    directory: Directory,
    stores: Vec<Store>,
    palette: Palette,
    max_bytes: usize,
    /// New bricks that there is room for; see [`Self::plan`].
    room: usize,
}

/// Bytes that a new brick is expected to come to with time: directory, slot, planes and table. Maps of buildings have 0.1 to
/// 0.3 kB a brick.
const EXPECTED_BYTES: usize = 320;

/// Bytes of a brick of which all voxels are equal.
const UNIFORM_BYTES: usize = 32;

/// The store of a place, and the brick's index there.
#[inline]
pub(crate) fn split_place(place: u32) -> (usize, u32) {
    (place as usize % SHARDS, place >> SHARD_BITS)
}

impl Bricks {
    pub(crate) fn new(max_bytes: usize, sensor: SensorModel) -> Self {
        Self {
            directory: Directory::default(),
            stores: vec![Store::default(); SHARDS],
            palette: Palette::new(sensor),
            max_bytes,
            room: 0,
        }
    }

    pub(crate) fn len(&self) -> u32 {
        self.directory.len()
    }

    pub(crate) fn max_bytes(&self) -> usize {
        self.max_bytes
    }

    /// Finds out how many new bricks there is room for. The last eighth of what the map may take is for the bricks that
    /// are there, which may need more bits.
    pub(crate) fn plan(&mut self) {
        self.room =
            (self.free_for_new() / EXPECTED_BYTES).min(((NOWHERE >> SHARD_BITS) - self.len()) as usize);
    }

    /// Whether there is room for so many new bricks of equal voxels.
    pub(crate) fn has_room_for_uniform(&self, bricks: u64) -> bool {
        bricks <= (self.max_bytes.saturating_sub(self.memory_bytes()) / UNIFORM_BYTES) as u64
    }

    fn free_for_new(&self) -> usize {
        let used = self.memory_bytes() - self.free_bytes();
        // Free places between bricks are an eighth at most before they move together.
        let taken = (used + used / 8).max(self.len() as usize * EXPECTED_BYTES);
        (self.max_bytes - self.max_bytes / 8).saturating_sub(taken)
    }

    /// Bytes held, the directory included.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.directory.memory_bytes()
            + self.palette.memory_bytes()
            + self.stores.iter().map(Store::memory_bytes).sum::<usize>()
    }

    /// Bytes held that hold nothing now.
    pub(crate) fn free_bytes(&self) -> usize {
        self.stores.iter().map(Store::free_bytes).sum()
    }

    /// Place of the brick; it never moves.
    #[inline]
    pub(crate) fn find(&self, code: u64) -> Option<u32> {
        self.find_near(code, &mut Near::default())
    }

    /// The same, faster where `near` is from a look-up close by.
    #[inline]
    pub(crate) fn find_near(&self, code: u64, near: &mut Near) -> Option<u32> {
        let place = self.directory.find_near(code, near);
        (place != NOWHERE).then_some(place)
    }

    /// The same, with a new brick where there was none; `None` where the last [`Self::plan`] left no room.
    #[inline]
    pub(crate) fn find_or_add(&mut self, code: u64, near: &mut Near) -> Option<u32> {
        let place = self.directory.find_near(code, near);
        if place != NOWHERE { Some(place) } else { self.add(code, near) }
    }

    /// The same after a plan of its own.
    #[inline]
    pub(crate) fn find_or_add_one(&mut self, code: u64, near: &mut Near) -> Option<u32> {
        let place = self.directory.find_near(code, near);
        if place != NOWHERE {
            return Some(place);
        }
        self.plan();
        self.add(code, near)
    }

    fn add(&mut self, code: u64, near: &mut Near) -> Option<u32> {
        self.room = self.room.checked_sub(1)?;
        let shard = code as usize % SHARDS;
        let place = self.stores[shard].add() << SHARD_BITS | shard as u32;
        self.directory.insert(code, place);
        *near = Near::default();
        Some(place)
    }

    /// Forgets a brick.
    pub(crate) fn remove(&mut self, code: u64) {
        let Some(place) = self.find(code) else { return };
        self.directory.remove(code);
        let (shard, index) = split_place(place);
        self.stores[shard].remove(index);
    }

    /// The store of a place, and the brick's index there.
    #[inline]
    pub(crate) fn at(&self, place: u32) -> (&Store, u32) {
        let (shard, index) = split_place(place);
        (&self.stores[shard], index)
    }

    /// The same, to be written.
    #[inline]
    pub(crate) fn at_mut(&mut self, place: u32) -> (&mut Store, u32) {
        let (shard, index) = split_place(place);
        (&mut self.stores[shard], index)
    }

    /// Before a scan: gives numbers of values that have gone to new ones, where few are left.
    pub(crate) fn recycle_states(&mut self) {
        if self.palette.is_nearly_full() {
            self.palette.recycle(|used| self.stores.iter().for_each(|store| store.mark_states(used)));
        }
    }

    /// All stores, for threads, and what their states mean.
    pub(crate) fn stores_mut(&mut self) -> (&mut [Store], &mut Palette) {
        (&mut self.stores, &mut self.palette)
    }

    /// What the states in the stores mean.
    #[inline]
    pub(crate) fn palette(&self) -> &Palette {
        &self.palette
    }

    /// Gives voxels of a brick one value.
    pub(crate) fn assign(&mut self, place: u32, mask: &Mask, value: f32, revision: u32) {
        let (shard, index) = split_place(place);
        self.stores[shard].assign(index, mask, value, &mut self.palette);
        self.stores[shard].set_revision(index, revision);
    }

    /// Gives a new brick its voxels.
    pub(crate) fn fill(&mut self, place: u32, groups: &Groups, revision: u32) {
        let (shard, index) = split_place(place);
        if !self.stores[shard].fill(index, groups, &mut self.palette) {
            for (value, voxels) in groups.iter() {
                self.stores[shard].assign(index, voxels, value, &mut self.palette);
            }
        }
        self.stores[shard].set_revision(index, revision);
    }

    /// Forgets value and flag of voxels.
    pub(crate) fn erase(&mut self, place: u32, mask: &Mask, revision: u32) {
        let (shard, index) = split_place(place);
        self.stores[shard].erase(index, mask, &self.palette);
        self.stores[shard].set_revision(index, revision);
    }

    /// The words in which occupied voxels may be; see [`Store::occupied_words`].
    #[inline]
    pub(crate) fn occupied_words(&self, place: u32) -> u8 {
        let (store, index) = self.at(place);
        store.occupied_words(index)
    }

    /// Log-odds of a brick's voxel; `None` where it is unknown.
    #[inline]
    pub(crate) fn value(&self, place: u32, voxel: usize) -> Option<f32> {
        let (store, index) = self.at(place);
        store.value(index, voxel, &self.palette)
    }

    /// The voxels with a value.
    pub(crate) fn known(&self, place: u32) -> Mask {
        let (store, index) = self.at(place);
        store.known(index)
    }

    /// The voxels with a ground flag.
    pub(crate) fn ground(&self, place: u32) -> Mask {
        let (store, index) = self.at(place);
        store.ground(index)
    }

    /// Calls `visit` with code and place of every brick that overlaps a box of keys, both inclusive.
    #[inline]
    pub(crate) fn for_each_in(&self, min: Key, max: Key, visit: impl FnMut(u64, u32)) {
        self.directory.for_each_in(min.map(|axis| axis >> 3), max.map(|axis| axis >> 3), visit);
    }

    /// Codes and places of all bricks in Morton order.
    pub(crate) fn sorted(&self) -> Vec<(u64, u32)> {
        self.directory.sorted()
    }

    /// The same of those in which a voxel is known.
    pub(crate) fn sorted_known(&self) -> Vec<(u64, u32)> {
        let mut sorted = self.sorted();
        sorted.retain(|&(_, place)| {
            let (store, index) = self.at(place);
            store.is_known(index)
        });
        sorted
    }
}

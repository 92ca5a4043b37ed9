//! The marks of a scan become new log-odds.

use crate::ScanReport;
use crate::bricks::{SHARDS, split_place};
use crate::directory::Near;
use crate::map::OctreeMap;
use crate::marks::{BrickMarks, ScanMarks};
use crate::mask::{self, Mask, WORDS};
use crate::palette::Palette;
use crate::rays::Helper;
use crate::store::{Missing, Store, Sums};

/// A marked brick in Morton order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Marked {
    /// Morton code.
    pub(crate) brick: u64,
    /// Where its marks are.
    pub(crate) slot: u32,
    /// Where it is in the map.
    pub(crate) place: u32,
    /// Which of its store's marked bricks it is.
    pub(crate) number: u32,
}

/// What a scan does to the bricks of one store.
#[derive(Debug, Default)]
pub(crate) struct StoreWork {
    /// Where the marks are, and the brick's index in the store.
    bricks: Vec<(u32, u32)>,
    /// The voxels with a new value or flag.
    pub(crate) changed: Vec<Mask>,
    sums: Sums,
    /// Those of `bricks` that have to wait until the palette knows their new values.
    waiting: Vec<u32>,
}

impl StoreWork {
    /// Updates the bricks as far as the palette knows the values.
    fn run(&mut self, store: &mut Store, marks: Joined<'_>, stamps: (u32, u32), palette: &Palette) {
        self.sums = Sums::default();
        self.changed.clear();
        self.waiting.clear();
        for (number, &(slot, index)) in self.bricks.iter().enumerate() {
            let mut changed = [0; WORDS];
            let free = marks.free(slot);
            let marks = BrickMarks { free: &free, ends: marks.marks.ends(slot) };
            match store.update(index, marks, &mut changed, stamps, palette) {
                Ok(sums) => self.sums += sums,
                Err(Missing(..)) => self.waiting.push(number as u32),
            }
            self.changed.push(changed);
        }
    }

    /// Updates the others, which gives the palette their values.
    fn finish(&mut self, store: &mut Store, marks: Joined<'_>, stamps: (u32, u32), palette: &mut Palette) {
        for &number in &self.waiting {
            let (slot, index) = self.bricks[number as usize];
            let changed = &mut self.changed[number as usize];
            let free = marks.free(slot);
            let marks = BrickMarks { free: &free, ends: marks.marks.ends(slot) };
            self.sums += loop {
                match store.update(index, marks, changed, stamps, palette) {
                    Ok(sums) => break sums,
                    Err(Missing(state, update)) if palette.compute(state, update) => {}
                    Err(Missing(..)) => store.make_floats(index, palette),
                }
            };
        }
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        self.bricks.capacity() * size_of::<(u32, u32)>()
            + self.changed.capacity() * size_of::<Mask>()
            + self.waiting.capacity() * 4
    }
}

/// The marks of all threads.
#[derive(Clone, Copy)]
struct Joined<'a> {
    marks: &'a ScanMarks,
    helpers: &'a [Helper],
}

impl Joined<'_> {
    #[inline]
    fn free(&self, slot: u32) -> Mask {
        let mut free = *self.marks.free(slot);
        for helper in self.helpers {
            if let Some(more) = helper.free(slot) {
                free.iter_mut().zip(more).for_each(|(word, more)| *word |= more);
            }
        }
        free
    }
}

impl OctreeMap {
    /// Puts the marked bricks in Morton order, so that what follows does not depend on the order of the points. Where a
    /// box `limits` the scan a brick may have no marks any more.
    fn sort_marked(&mut self, limited: bool) {
        let joined = Joined { marks: &self.marks, helpers: &self.helpers };
        self.marked.clear();
        let marked = self.marks.bricks().map(|(slot, brick)| Marked { brick, slot, place: 0, number: 0 });
        self.marked.extend(marked.filter(|&Marked { slot, .. }| {
            !limited
                || !mask::is_empty(&joined.free(slot))
                || self.marks.ends(slot).is_some_and(|ends| !ends.is_empty())
        }));
        self.marked.sort_unstable_by_key(|marked| marked.brick);
    }

    /// Updates each marked voxel once. Which bricks are refused where the map is full follows Morton order.
    pub(crate) fn apply_marks(&mut self, limited: bool, report: &mut ScanReport) {
        self.sort_marked(limited);
        self.scan = self.scan.wrapping_add(1);
        self.revision = self.revision.wrapping_add(1);
        self.work.iter_mut().for_each(|work| work.bricks.clear());
        self.bricks.recycle_states();
        self.bricks.plan();
        let (bricks, work) = (&mut self.bricks, &mut self.work);
        let mut near = Near::default();
        self.marked.retain_mut(|marked| {
            let Some(place) = bricks.find_or_add(marked.brick, &mut near) else {
                report.refused_bricks = report.refused_bricks.saturating_add(1);
                return false;
            };
            let (store, index) = split_place(place);
            marked.place = place;
            marked.number = work[store].bricks.len() as u32;
            work[store].bricks.push((marked.slot, index));
            true
        });
        let marks = Joined { marks: &self.marks, helpers: &self.helpers };
        let stamps = (self.scan, self.revision);
        let share = SHARDS.div_ceil(self.threads);
        let (stores, palette) = self.bricks.stores_mut();
        let mut shares = self.work.chunks_mut(share).zip(stores.chunks_mut(share));
        let known = &*palette;
        let run = |(works, stores): (&mut [StoreWork], &mut [Store])| {
            works.iter_mut().zip(stores).for_each(|(work, store)| work.run(store, marks, stamps, known));
        };
        let own = shares.next();
        if self.threads == 1 {
            own.map(run);
        } else {
            std::thread::scope(|scope| {
                for share in shares {
                    scope.spawn(move || run(share));
                }
                own.map(run);
            });
        }
        for (work, store) in self.work.iter_mut().zip(stores) {
            work.finish(store, marks, stamps, palette);
            store.tidy();
        }
        let mut sums = Sums::default();
        self.work.iter().for_each(|work| sums += work.sums);
        report.free_voxels = sums.free;
        report.occupied_voxels = sums.occupied;
        report.changed = sums.changed;
        self.known += sums.new as usize;
        self.listed += sums.listed as usize;
        self.changed = sums.changed as usize;
    }
}

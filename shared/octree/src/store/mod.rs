//! The voxels of bricks, each brick in as few bits as it has different values, exactly.

mod floats;
mod forms;
mod shape;
mod tidy;
mod update;
mod within;
mod write;

pub(crate) use update::{Missing, Sums};

use crate::decoded::Decoded;
use crate::mask::{self, Mask, WORDS};
use crate::numbers::{state_of, table_units};
use crate::palette::{Palette, State, UNKNOWN};
use crate::planes;
use crate::units::Units;

/// Planes of a brick whose numbers are the first states of the palette.
const FEW: usize = 2;

/// Planes of a brick whose numbers are states, any of them.
const ALL: usize = 16;

/// Units of a brick of plain values: 512 `f32`, two a word, NaN where unknown.
const FLOATS: usize = 32;

/// Where a brick's voxels are, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// All 512 have this state (as OctoMap prunes them to one leaf): no memory of their own.
    Uniform(State),
    /// Bit planes of numbers, and behind them a table of the states of `entries` numbers; without entries a number is a
    /// state.
    Planes { planes: u8, entries: u8, at: u32 },
    /// The last resort where the palette is full.
    Floats(u32),
}

/// No ground flag in the brick.
const NO_GROUND: u32 = u32::MAX;

#[derive(Clone, Copy, Debug)]
struct Slot {
    form: Form,
    /// Unit of the ground flags or [`NO_GROUND`].
    ground: u32,
    /// Number of the last scan that marked the brick.
    seen: u32,
    /// Number of the last change in it.
    revision: u32,
    /// Bit n: an occupied voxel may be in word n; if not, none is. Of no meaning where all voxels are equal.
    occupied: u8,
}

/// Bricks by index. A map has several stores, so that threads can update one each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Store {
    slots: Vec<Slot>,
    /// Slots without a brick.
    free: Vec<u32>,
    units: Units,
    /// The slot that [`Self::tidy`] looked at last.
    cursor: usize,
}

impl Store {
    /// Index of a new brick of which nothing is known.
    pub(crate) fn add(&mut self) -> u32 {
        let slot =
            Slot { form: Form::Uniform(UNKNOWN), ground: NO_GROUND, seen: 0, revision: 0, occupied: 0 };
        if let Some(index) = self.free.pop() {
            self.slots[index as usize] = slot;
            return index;
        }
        if self.slots.len() == self.slots.capacity() {
            self.slots.reserve_exact(self.slots.len() / 8 + 64);
        }
        self.slots.push(slot);
        self.slots.len() as u32 - 1
    }

    /// Forgets a brick and gives its memory back.
    pub(crate) fn remove(&mut self, index: u32) {
        self.set_form(index, Form::Uniform(UNKNOWN));
        self.remove_ground(index, &[u64::MAX; WORDS]);
        self.free.push(index);
    }

    /// Number of the last scan that marked the brick, and of its last change.
    #[inline]
    pub(crate) fn stamps(&self, index: u32) -> (u32, u32) {
        let slot = &self.slots[index as usize];
        (slot.seen, slot.revision)
    }

    pub(crate) fn set_revision(&mut self, index: u32, revision: u32) {
        self.slots[index as usize].revision = revision;
    }

    /// Log-odds of a voxel; `None` where it is unknown.
    #[inline]
    pub(crate) fn value(&self, index: u32, voxel: usize, palette: &Palette) -> Option<f32> {
        let state = match self.slots[index as usize].form {
            Form::Uniform(state) => state,
            Form::Planes { planes, entries, at } => {
                let (planes, table) = self.parts(planes, entries, at);
                state_of(table, planes::get(planes, voxel))
            }
            Form::Floats(at) => {
                let value = self.float(at, voxel);
                return (!value.is_nan()).then_some(value);
            }
        };
        (state != UNKNOWN).then(|| palette.value(state))
    }

    /// The value that all 512 voxels have, where they are known and have one.
    #[inline]
    pub(crate) fn uniform(&self, index: u32, palette: &Palette) -> Option<f32> {
        match self.slots[index as usize].form {
            Form::Uniform(state) if state != UNKNOWN => Some(palette.value(state)),
            Form::Floats(at) => self.common_float(at),
            _ => None,
        }
    }

    /// The words (bit n: word n) in which occupied voxels may be, of a brick whose voxels are not all equal.
    #[inline]
    pub(crate) fn occupied_words(&self, index: u32) -> u8 {
        self.slots[index as usize].occupied
    }

    /// Finds out where occupied voxels are.
    fn find_occupied(&mut self, index: u32, palette: &Palette) {
        let mut words = 0;
        self.for_each_value(index, palette, |word, _, value| {
            words |= u8::from(palette.occupies(value)) << word
        });
        self.slots[index as usize].occupied = words;
    }

    /// Whether any voxel has a value.
    #[inline]
    pub(crate) fn is_known(&self, index: u32) -> bool {
        match self.slots[index as usize].form {
            Form::Uniform(state) => state != UNKNOWN,
            // Planes whose voxels are all equal have become uniform.
            Form::Planes { .. } => true,
            Form::Floats(_) => !mask::is_empty(&self.known(index)),
        }
    }

    /// The voxels with a value.
    pub(crate) fn known(&self, index: u32) -> Mask {
        match self.slots[index as usize].form {
            Form::Uniform(UNKNOWN) => [0; WORDS],
            Form::Uniform(_) => [u64::MAX; WORDS],
            Form::Planes { planes, at, .. } => planes::nonzero(self.units.run(at, planes.into())),
            Form::Floats(at) => std::array::from_fn(|word| {
                (0..64)
                    .fold(0, |bits, bit| bits | u64::from(!self.float(at, word * 64 + bit).is_nan()) << bit)
            }),
        }
    }

    /// The voxels of a brick.
    pub(crate) fn decode(&self, index: u32, palette: &Palette, decoded: &mut Decoded) {
        match self.slots[index as usize].form {
            Form::Uniform(UNKNOWN) => decoded.unknown(),
            Form::Uniform(state) => decoded.uniform(palette.value(state)),
            Form::Planes { planes, entries, at } => {
                let (planes, table) = self.parts(planes, entries, at);
                decoded.planes(planes, table, entries.into(), palette);
            }
            Form::Floats(at) => decoded.floats(self.known(index), |voxel| self.float(at, voxel)),
        }
    }

    /// Calls `visit` with each value of a brick and voxels that have it: a word's equal voxels at a time.
    #[inline]
    pub(crate) fn for_each_value(
        &self,
        index: u32,
        palette: &Palette,
        mut visit: impl FnMut(usize, u64, f32),
    ) {
        match self.slots[index as usize].form {
            Form::Uniform(UNKNOWN) => {}
            Form::Uniform(state) => (0..WORDS).for_each(|word| visit(word, u64::MAX, palette.value(state))),
            Form::Planes { planes, entries, at } => {
                let (planes, table) = self.parts(planes, entries, at);
                for (word, mut left) in planes::nonzero(planes).into_iter().enumerate() {
                    while left != 0 {
                        let (same, number) = planes::alike(planes, word, left);
                        left &= !same;
                        visit(word, same, palette.value(state_of(table, number)));
                    }
                }
            }
            Form::Floats(at) => {
                for voxel in mask::Bits::of(self.known(index)) {
                    visit(voxel / 64, 1 << (voxel % 64), self.float(at, voxel));
                }
            }
        }
    }

    /// The voxels with a ground flag.
    #[inline]
    pub(crate) fn ground(&self, index: u32) -> Mask {
        match self.slots[index as usize].ground {
            NO_GROUND => [0; WORDS],
            at => self.units.run(at, 1)[0],
        }
    }

    /// Gives voxels the ground flag, besides those that have it.
    pub(crate) fn add_ground(&mut self, index: u32, flags: &Mask) {
        let slot = &mut self.slots[index as usize];
        if slot.ground == NO_GROUND {
            slot.ground = self.units.add(1);
            self.units.run_mut(slot.ground, 1)[0] = [0; WORDS];
        }
        let ground = &mut self.units.run_mut(slot.ground, 1)[0];
        ground.iter_mut().zip(flags).for_each(|(word, more)| *word |= more);
    }

    /// Takes the ground flag from voxels.
    fn remove_ground(&mut self, index: u32, flags: &Mask) {
        let slot = &mut self.slots[index as usize];
        if slot.ground == NO_GROUND {
            return;
        }
        let ground = &mut self.units.run_mut(slot.ground, 1)[0];
        ground.iter_mut().zip(flags).for_each(|(word, less)| *word &= !less);
        if mask::is_empty(ground) {
            self.units.remove(std::mem::replace(&mut slot.ground, NO_GROUND), 1);
        }
    }

    /// Notes which states occur, by state.
    pub(crate) fn mark_states(&self, used: &mut [bool]) {
        for (index, slot) in self.slots.iter().enumerate() {
            match slot.form {
                Form::Uniform(state) => used[usize::from(state)] = true,
                Form::Planes { planes, entries, at } if entries > 0 => {
                    let (_, table) = self.parts(planes, entries, at);
                    (0..u16::from(entries))
                        .for_each(|number| used[usize::from(state_of(table, number))] = true);
                }
                Form::Planes { planes, entries, at } => {
                    let (planes, _) = self.parts(planes, entries, at);
                    for (word, mut left) in self.known(index as u32).into_iter().enumerate() {
                        while left != 0 {
                            let (same, state) = planes::alike(planes, word, left);
                            left &= !same;
                            used[usize::from(state)] = true;
                        }
                    }
                }
                Form::Floats(_) => {}
            }
        }
    }

    /// Bytes held that hold nothing now.
    pub(crate) fn free_bytes(&self) -> usize {
        (self.slots.capacity() - self.slots.len() + self.free.len()) * size_of::<Slot>()
            + self.units.free_bytes()
    }

    /// Bytes held.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.slots.capacity() * size_of::<Slot>() + self.free.capacity() * 4 + self.units.memory_bytes()
    }
}

/// Units of a brick.
fn run_length(planes: u8, entries: u8) -> usize {
    let planes = usize::from(planes);
    if entries == 0 { planes } else { planes + table_units(planes) }
}

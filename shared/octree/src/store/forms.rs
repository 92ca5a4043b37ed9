//! A brick changes its form: from one value to planes, to more planes, and back.

use super::{ALL, FEW, FLOATS, Form, Store, run_length};
use crate::mask::{self, WORDS};
use crate::numbers::{MAX_ENTRIES, set_state, state_of};
use crate::palette::{Palette, State, UNKNOWN};
use crate::planes;
use crate::units::Unit;

impl Store {
    /// Gives the brick planes, in which all voxels have one state.
    pub(super) fn expand(&mut self, index: u32, state: State, palette: &Palette) {
        let (planes, entries, number) =
            if usize::from(state) < 1 << FEW { (FEW as u8, 0, state) } else { (3, 2, 1) };
        let at = self.units.add(run_length(planes, entries));
        let (brick, table) = self.units.run_mut(at, run_length(planes, entries)).split_at_mut(planes.into());
        (0..WORDS).for_each(|word| planes::put(brick, word, u64::MAX, number));
        set_state(table, 0, UNKNOWN);
        set_state(table, 1, state);
        let slot = &mut self.slots[index as usize];
        slot.form = Form::Planes { planes, entries, at };
        slot.occupied = if state != UNKNOWN && palette.occupies(palette.value(state)) { u8::MAX } else { 0 };
    }

    /// Numbers the states that do occur anew, in planes that hold at least `capacity` numbers and in any case a few more
    /// than there are. Gives how many they hold.
    pub(super) fn rebuild(&mut self, index: u32, capacity: usize) -> usize {
        let Form::Planes { planes, entries, at } = self.slots[index as usize].form else { return 0 };
        let (old, table) = self.parts(planes, entries, at);
        let numbers = if entries == 0 { 1 << planes } else { u16::from(entries) };
        let (mut states, mut live) = ([UNKNOWN; MAX_ENTRIES], 1);
        let mut fresh = [[0; WORDS]; ALL];
        let mut masks = [[0; WORDS]; MAX_ENTRIES];
        for number in 1..numbers {
            let voxels = planes::equal(old, number);
            if !mask::is_empty(&voxels) {
                (states[live], masks[live]) = (state_of(table, number), voxels);
                live += 1;
            }
        }
        let capacity = capacity.max(live + (live / 4).max(2));
        let bits = capacity.next_power_of_two().trailing_zeros().max(3) as usize;
        let (planes, entries) = if 1 << bits <= MAX_ENTRIES { (bits, live as u8) } else { (ALL, 0) };
        for number in 1..live {
            let written = if entries == 0 { states[number] } else { number as u16 };
            for (word, voxels) in masks[number].iter().enumerate() {
                planes::put(&mut fresh[..planes], word, *voxels, written);
            }
        }
        let at = self.units.add(run_length(planes as u8, entries));
        let (brick, table) = self.units.run_mut(at, run_length(planes as u8, entries)).split_at_mut(planes);
        brick.copy_from_slice(&fresh[..planes]);
        for (number, state) in states[..usize::from(entries)].iter().enumerate() {
            set_state(table, number, *state);
        }
        self.set_form(index, Form::Planes { planes: planes as u8, entries, at });
        1 << planes
    }

    /// Frees the planes of a brick whose voxels have all become equal.
    pub(super) fn collapse(&mut self, index: u32) {
        if let Form::Planes { planes, entries, at } = self.slots[index as usize].form {
            let (planes, table) = self.parts(planes, entries, at);
            if let Some(number) = planes::uniform(planes) {
                self.set_form(index, Form::Uniform(state_of(table, number)));
            }
        }
    }

    /// A brick's planes and its table.
    #[inline]
    pub(super) fn parts(&self, planes: u8, entries: u8, at: u32) -> (&[Unit], &[Unit]) {
        self.units.run(at, run_length(planes, entries)).split_at(planes.into())
    }

    /// Gives back what the old form held.
    pub(super) fn set_form(&mut self, index: u32, form: Form) {
        match std::mem::replace(&mut self.slots[index as usize].form, form) {
            Form::Uniform(_) => {}
            Form::Planes { planes, entries, at } => self.units.remove(at, run_length(planes, entries)),
            Form::Floats(at) => self.units.remove(at, FLOATS),
        }
    }
}

//! Voxels of a brick set from outside.

use super::{ALL, FEW, Form, Store, run_length};
use crate::mask::{self, Mask, WORDS};
use crate::numbers::{MAX_ENTRIES, set_state, state_of};
use crate::palette::{Palette, State, UNKNOWN};
use crate::planes;

impl Store {
    /// Gives the voxels of `mask` one value.
    pub(crate) fn assign(&mut self, index: u32, mask: &Mask, value: f32, palette: &mut Palette) {
        let occupied = if palette.occupies(value) { mask::words(mask) } else { 0 };
        if matches!(self.slots[index as usize].form, Form::Floats(_)) {
            self.put_floats(index, mask, value);
            self.slots[index as usize].occupied |= occupied;
            return;
        }
        match palette.state(value) {
            Some(state) => self.put(index, mask, state, palette),
            None => {
                self.make_floats(index, palette);
                self.put_floats(index, mask, value);
            }
        }
        self.slots[index as usize].occupied |= occupied;
    }

    /// Forgets value and flag of the voxels of `mask`.
    pub(crate) fn erase(&mut self, index: u32, mask: &Mask, palette: &Palette) {
        self.remove_ground(index, mask);
        match self.slots[index as usize].form {
            Form::Floats(_) => self.put_floats(index, mask, f32::NAN),
            _ => self.put(index, mask, UNKNOWN, palette),
        }
    }

    pub(super) fn put(&mut self, index: u32, mask: &Mask, state: State, palette: &Palette) {
        if *mask == [u64::MAX; WORDS] {
            self.set_form(index, Form::Uniform(state));
            return;
        }
        loop {
            let (planes, entries, at) = match self.slots[index as usize].form {
                Form::Uniform(common) if common == state => return,
                Form::Uniform(common) => {
                    self.expand(index, common, palette);
                    continue;
                }
                Form::Floats(_) => return,
                Form::Planes { planes, entries, at } => (planes, entries, at),
            };
            let (brick, table) =
                self.units.run_mut(at, run_length(planes, entries)).split_at_mut(planes.into());
            let limit = 1_usize << planes;
            let known = (0..entries).map(u16::from).find(|&number| state_of(table, number) == state);
            let number = match known {
                _ if entries == 0 => Some(state).filter(|state| usize::from(*state) < limit),
                None if usize::from(entries) < limit => {
                    set_state(table, entries.into(), state);
                    self.slots[index as usize].form = Form::Planes { planes, entries: entries + 1, at };
                    Some(u16::from(entries))
                }
                known => known,
            };
            let Some(number) = number else {
                self.rebuild(index, 0);
                continue;
            };
            for (word, mask) in mask.iter().enumerate() {
                planes::put(brick, word, *mask, number);
            }
            self.collapse(index);
            return;
        }
    }

    /// Gives a new brick all its voxels at once; unknown ones are [`UNKNOWN`].
    pub(crate) fn fill(&mut self, index: u32, states_of_brick: &[State; mask::BRICK_VOXELS]) {
        let (mut table, mut entries) = ([UNKNOWN; MAX_ENTRIES], 1);
        let mut masks = [[0; WORDS]; MAX_ENTRIES];
        let mut last = 0;
        for (word, states) in states_of_brick.as_chunks::<64>().0.iter().enumerate() {
            for (bit, &state) in states.iter().enumerate() {
                if state != table[last] {
                    last = match table[..entries].iter().position(|entry| *entry == state) {
                        Some(number) => number,
                        None if entries < MAX_ENTRIES => {
                            table[entries] = state;
                            entries += 1;
                            entries - 1
                        }
                        None => return self.fill_with_states(index, states_of_brick),
                    };
                }
                masks[last][word] |= 1 << bit;
            }
        }
        let few = table[..entries].iter().all(|state| usize::from(*state) < 1 << FEW);
        let mut planes = [[0; WORDS]; ALL];
        for number in 1..entries {
            let mut bits = if few { usize::from(table[number]) } else { number };
            while bits != 0 {
                let plane = &mut planes[bits.trailing_zeros() as usize];
                plane.iter_mut().zip(&masks[number]).for_each(|(word, voxels)| *word |= voxels);
                bits &= bits - 1;
            }
        }
        let bits = if few { FEW } else { entries.next_power_of_two().trailing_zeros().max(3) as usize };
        let entries = if few { 0 } else { entries as u8 };
        let at = self.units.add(run_length(bits as u8, entries));
        let (brick, behind) = self.units.run_mut(at, run_length(bits as u8, entries)).split_at_mut(bits);
        brick.copy_from_slice(&planes[..bits]);
        for (number, state) in table[..usize::from(entries)].iter().enumerate() {
            set_state(behind, number, *state);
        }
        self.set_form(index, Form::Planes { planes: bits as u8, entries, at });
        self.collapse(index);
    }

    pub(super) fn fill_with_states(&mut self, index: u32, states: &[State; mask::BRICK_VOXELS]) {
        let at = self.units.add(ALL);
        let brick = self.units.run_mut(at, ALL);
        brick.fill([0; WORDS]);
        for (voxel, &state) in states.iter().enumerate() {
            for (n, plane) in brick.iter_mut().enumerate() {
                plane[voxel / 64] |= u64::from(state >> n & 1) << (voxel % 64);
            }
        }
        self.set_form(index, Form::Planes { planes: ALL as u8, entries: 0, at });
    }
}

//! Voxels of a brick set from outside.

use super::{ALL, FEW, Form, Store, run_length};
use crate::build::Groups;
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

    /// Gives a new brick all its voxels at once; `false`, and nothing done, where the palette has no numbers left.
    pub(crate) fn fill(&mut self, index: u32, groups: &Groups, palette: &mut Palette) -> bool {
        // Numbers are states where those are few, or too many for a table.
        let numbers = groups.iter().len() + 1;
        let (mut few, mut states) = (true, [UNKNOWN; mask::BRICK_VOXELS]);
        for ((value, _), state) in groups.iter().zip(&mut states) {
            let Some(known) = palette.state(value) else { return false };
            *state = known;
            few &= usize::from(known) < 1 << FEW;
        }
        let (bits, entries) = match numbers {
            _ if few => (FEW, 0),
            ..=MAX_ENTRIES => (numbers.next_power_of_two().trailing_zeros().max(3) as usize, numbers as u8),
            _ => (ALL, 0),
        };
        let at = self.units.add(run_length(bits as u8, entries));
        let (brick, table) = self.units.run_mut(at, run_length(bits as u8, entries)).split_at_mut(bits);
        brick.fill([0; WORDS]);
        set_state(table, 0, UNKNOWN);
        let mut occupied = 0;
        for (n, ((value, voxels), state)) in groups.iter().zip(states).enumerate() {
            set_state(table, n + 1, state);
            let mut left = if entries > 0 { n + 1 } else { usize::from(state) };
            while left != 0 {
                let plane = &mut brick[left.trailing_zeros() as usize];
                plane.iter_mut().zip(voxels).for_each(|(word, voxels)| *word |= voxels);
                left &= left - 1;
            }
            occupied |= if palette.occupies(value) { mask::words(voxels) } else { 0 };
        }
        self.set_form(index, Form::Planes { planes: bits as u8, entries, at });
        self.slots[index as usize].occupied = occupied;
        self.collapse(index);
        true
    }
}

//! What an octree over a brick looks like.

use super::{Form, Store};
use crate::decoded::{Decoded, LOWEST, any_bit};
use crate::mask::{Mask, WORDS};
use crate::numbers::state_of;
use crate::palette::{Palette, UNKNOWN};
use crate::planes;

/// Which voxels are known, and which blocks of eight and words are leaves, as in [`Decoded`].
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Shape {
    pub(crate) known: Mask,
    /// By word, bit 0 of each byte: its eight voxels are known and equal.
    pub(crate) blocks: Mask,
    /// Bit n: the 64 voxels of word n are known and equal.
    pub(crate) words: u8,
}

impl Store {
    /// The shape of a brick whose voxels are not all equal.
    #[inline]
    pub(crate) fn shape(&self, index: u32, palette: &Palette) -> Shape {
        let Form::Planes { planes, entries, at } = self.slots[index as usize].form else {
            let mut decoded = Decoded::default();
            self.decode(index, palette, &mut decoded);
            return Shape { known: decoded.known, blocks: decoded.blocks, words: decoded.words };
        };
        let (planes, _) = self.parts(planes, entries, at);
        let (mut known, mut differ, mut parted) = ([0; WORDS], [0; WORDS], [0; WORDS]);
        for plane in planes {
            for word in 0..WORDS {
                let bits = plane[word];
                known[word] |= bits;
                differ[word] |= (bits ^ bits >> 1) & !(LOWEST << 7);
                parted[word] |= bits ^ (bits & 1).wrapping_neg();
            }
        }
        let mut shape = Shape { known, ..Shape::default() };
        for word in 0..WORDS {
            shape.blocks[word] = !any_bit(differ[word]) & any_bit(known[word]) & LOWEST;
            shape.words |= u8::from(known[word] != 0 && parted[word] == 0) << word;
        }
        shape
    }

    /// The occupied voxels of a brick.
    pub(crate) fn occupied(&self, index: u32, palette: &Palette) -> Mask {
        let mut occupied = [0; WORDS];
        match self.slots[index as usize] {
            super::Slot { occupied: 0, form: Form::Planes { .. } | Form::Floats(_), .. } => {}
            super::Slot { form: Form::Planes { planes, entries, at }, .. } if entries > 0 => {
                let (planes, table) = self.parts(planes, entries, at);
                for number in 1..u16::from(entries) {
                    let state = state_of(table, number);
                    if state != UNKNOWN && palette.occupies(palette.value(state)) {
                        let voxels = planes::equal(planes, number);
                        occupied.iter_mut().zip(voxels).for_each(|(all, word)| *all |= word);
                    }
                }
            }
            _ => self.for_each_value(index, palette, |word, voxels, value| {
                occupied[word] |= if palette.occupies(value) { voxels } else { 0 };
            }),
        }
        occupied
    }
}

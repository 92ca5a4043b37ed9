//! The leaves of a brick that reach into a box, straight from the bit planes.

use super::{Form, Store};
use crate::decoded::{Decoded, LOWEST, any_bit};
use crate::mask::{self, Bits, Mask, WORDS};
use crate::numbers::state_of;
use crate::palette::Palette;
use crate::planes;

/// Depths of a brick's leaves: of a voxel, of eight, of a word.
const DEPTHS: [u8; 3] = [16, 15, 14];

impl Store {
    /// Calls `visit` with the first voxel, the depth and the value of each leaf that has a voxel of `inside`, of a
    /// brick whose voxels are not all equal.
    #[inline]
    pub(crate) fn for_each_leaf_within(
        &self,
        index: u32,
        palette: &Palette,
        inside: &Mask,
        mut visit: impl FnMut(usize, u8, f32),
    ) {
        let [voxel_depth, block_depth, word_depth] = DEPTHS;
        match self.slots[index as usize].form {
            Form::Uniform(_) => {}
            Form::Planes { planes, entries, at } => {
                let (planes, table) = self.parts(planes, entries, at);
                let value = |voxel| palette.value(state_of(table, planes::get(planes, voxel)));
                for word in 0..WORDS {
                    if inside[word] == 0 {
                        continue;
                    }
                    let (mut known, mut differ, mut parted) = (0, 0, 0);
                    for plane in planes {
                        let bits = plane[word];
                        known |= bits;
                        differ |= (bits ^ bits >> 1) & !(LOWEST << 7);
                        parted |= bits ^ (bits & 1).wrapping_neg();
                    }
                    if known == 0 {
                        continue;
                    }
                    if parted == 0 {
                        visit(word * 64, word_depth, value(word * 64));
                        continue;
                    }
                    let blocks = !any_bit(differ) & any_bit(known) & LOWEST;
                    let mut reached = blocks & any_bit(inside[word]);
                    while reached != 0 {
                        let first = word * 64 + reached.trailing_zeros() as usize;
                        reached &= reached - 1;
                        visit(first, block_depth, value(first));
                    }
                    let mut left = known & inside[word] & !blocks.wrapping_mul(0xff);
                    while left != 0 {
                        let voxel = word * 64 + left.trailing_zeros() as usize;
                        left &= left - 1;
                        visit(voxel, voxel_depth, value(voxel));
                    }
                }
            }
            Form::Floats(_) => {
                let mut decoded = Decoded::default();
                self.decode(index, palette, &mut decoded);
                for word in (0..WORDS).filter(|word| inside[*word] != 0) {
                    if decoded.words >> word & 1 != 0 {
                        visit(word * 64, word_depth, decoded.values[word * 64]);
                        continue;
                    }
                    for block in Bits::of(mask::word(word, decoded.blocks[word] & any_bit(inside[word]))) {
                        visit(block, block_depth, decoded.values[block]);
                    }
                    let single =
                        decoded.known[word] & inside[word] & !decoded.blocks[word].wrapping_mul(0xff);
                    for voxel in Bits::of(mask::word(word, single)) {
                        visit(voxel, voxel_depth, decoded.values[voxel]);
                    }
                }
            }
        }
    }
}

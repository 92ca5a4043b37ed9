//! A brick's voxels as plain values, with what the levels of an octree above them need to know.

use crate::mask::{self, BRICK_VOXELS, Mask, WORDS};
use crate::numbers::state_of;
use crate::palette::Palette;
use crate::units::Unit;

/// Bit 0 of each byte.
pub(crate) const LOWEST: u64 = 0x0101_0101_0101_0101;

/// Room for the voxels of one brick. In Morton order a word of a mask is a block of 4 x 4 x 4 voxels, a node of depth 14,
/// and a byte one of 2 x 2 x 2, a node of depth 15.
#[derive(Clone, Debug)]
pub(crate) struct Decoded {
    /// Log-odds where `known` has the bit. Of a byte in `blocks` only the first is there.
    pub(crate) values: [f32; BRICK_VOXELS],
    pub(crate) known: Mask,
    /// By word, bit 0 of each byte: its eight voxels are known and equal.
    pub(crate) blocks: Mask,
    /// Bit n: the 64 voxels of word n are known and equal.
    pub(crate) words: u8,
}

impl Default for Decoded {
    fn default() -> Self {
        Self { values: [0.0; BRICK_VOXELS], known: [0; WORDS], blocks: [0; WORDS], words: 0 }
    }
}

impl Decoded {
    /// Decodes bit planes with their table of states.
    pub(crate) fn planes(&mut self, planes: &[Unit], table: &[Unit], entries: usize, palette: &Palette) {
        let mut by_number = [0.0; 128];
        for (number, value) in by_number[..entries].iter_mut().enumerate() {
            *value = palette.value(state_of(table, number as u16));
        }
        self.words = 0;
        for word in 0..WORDS {
            let (mut known, mut differ, mut uniform) = (0, 0, true);
            for plane in planes {
                let bits = plane[word];
                known |= bits;
                differ |= (bits ^ bits >> 1) & !(LOWEST << 7);
                uniform &= bits == 0 || bits == u64::MAX;
            }
            self.known[word] = known;
            // Bytes without a known voxel differ in nothing, either.
            let blocks = !any_bit(differ) & any_bit(known) & LOWEST;
            self.blocks[word] = blocks;
            if uniform && known != 0 {
                self.words |= 1 << word;
                let number = crate::planes::get(planes, word * 64);
                let state = if entries > 0 { state_of(table, number) } else { number };
                self.values[word * 64..][..64].fill(palette.value(state));
                continue;
            }
            for block in 0..8 {
                let shift = 8 * block;
                if known >> shift & 0xff == 0 {
                    continue;
                }
                let at = word * 64 + shift;
                if blocks >> shift & 1 != 0 {
                    let number = planes
                        .iter()
                        .enumerate()
                        .fold(0, |number, (n, plane)| number | ((plane[word] >> shift & 1) as u16) << n);
                    self.values[at] = if entries > 0 {
                        by_number[usize::from(number) % 128]
                    } else {
                        palette.value(number)
                    };
                } else if entries > 0 {
                    let spread = planes.iter().enumerate();
                    let numbers =
                        spread.fold(0, |all, (n, plane)| all | spread_byte(plane[word] >> shift) << n);
                    for (value, number) in self.values[at..at + 8].iter_mut().zip(numbers.to_le_bytes()) {
                        *value = by_number[usize::from(number) % 128];
                    }
                } else {
                    for voxel in at..at + 8 {
                        self.values[voxel] = palette.value(crate::planes::get(planes, voxel));
                    }
                }
            }
        }
    }

    /// Takes over values, NaN where unknown.
    pub(crate) fn floats(&mut self, known: Mask, value: impl Fn(usize) -> f32) {
        self.known = known;
        self.words = 0;
        for voxel in mask::Bits::of(known) {
            self.values[voxel] = value(voxel);
        }
        for (word, values) in self.values.as_chunks::<64>().0.iter().enumerate() {
            self.blocks[word] = (0..8).fold(0, |bits, block| {
                let first = values[8 * block];
                let equal = known[word] >> (8 * block) & 0xff == 0xff
                    && values[8 * block..][..8].iter().all(|value| *value == first);
                bits | u64::from(equal) << (8 * block)
            });
            let equal =
                self.blocks[word] == LOWEST && values.iter().step_by(8).all(|value| *value == values[0]);
            self.words |= u8::from(equal) << word;
        }
    }

    /// All voxels have this value.
    pub(crate) fn uniform(&mut self, value: f32) {
        self.values.fill(value);
        self.known = [u64::MAX; WORDS];
        self.blocks = [LOWEST; WORDS];
        self.words = u8::MAX;
    }

    /// Nothing is known.
    pub(crate) fn unknown(&mut self) {
        self.known = [0; WORDS];
        self.blocks = [0; WORDS];
        self.words = 0;
    }

    /// A voxel's value.
    #[inline]
    pub(crate) fn value(&self, voxel: usize) -> Option<f32> {
        let in_block = self.blocks[voxel / 64] >> (voxel % 64 / 8 * 8) & 1 != 0;
        mask::has(&self.known, voxel).then(|| self.values[if in_block { voxel & !7 } else { voxel }])
    }

    /// Greatest value of a word's voxels, of which at least one is known.
    pub(crate) fn greatest_of_word(&self, word: usize) -> f32 {
        (0..8)
            .filter(|block| self.known[word] >> (8 * block) & 0xff != 0)
            .fold(f32::NEG_INFINITY, |max, block| max.max(self.greatest_of_block(word, block)))
    }

    /// The same of a block of eight.
    #[inline]
    pub(crate) fn greatest_of_block(&self, word: usize, block: usize) -> f32 {
        let first = word * 64 + 8 * block;
        if self.blocks[word] >> (8 * block) & 1 != 0 {
            return self.values[first];
        }
        let present = self.known[word] >> (8 * block);
        (0..8)
            .filter(|bit| present >> bit & 1 != 0)
            .fold(f32::NEG_INFINITY, |max, bit| max.max(self.values[first + bit]))
    }
}

/// Bit 0 of each byte in which a bit is set.
#[inline]
pub(crate) fn any_bit(word: u64) -> u64 {
    let word = word | word >> 4;
    let word = word & 0x0f0f_0f0f_0f0f_0f0f;
    let word = word | word >> 2;
    (word | word >> 1) & LOWEST
}

/// The eight low bits as bit 0 of eight bytes.
#[inline]
fn spread_byte(bits: u64) -> u64 {
    // Seven copies side by side meet without carrying; the eighth bit has its place to itself.
    ((bits & 0x7f).wrapping_mul(0x0002_0408_1020_4081) & LOWEST) | (bits >> 7 & 1) << 56
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bits_spread_and_gather_as_written(word in any::<u64>()) {
            for (n, byte) in word.to_le_bytes().into_iter().enumerate() {
                prop_assert_eq!(any_bit(word) >> (8 * n) & 0xff, u64::from(byte != 0));
                let spread = spread_byte(u64::from(byte)).to_le_bytes();
                for (bit, value) in spread.into_iter().enumerate() {
                    prop_assert_eq!(value, byte >> bit & 1);
                }
            }
        }
    }
}

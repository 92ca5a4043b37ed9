//! One bit per voxel of a brick.

use crate::Key;
use crate::morton::BRICK_BITS;

/// Voxels of a brick.
pub(crate) const BRICK_VOXELS: usize = 1 << BRICK_BITS;

/// 64-bit words of a mask; a word is a block of 4 x 4 x 4 voxels.
pub(crate) const WORDS: usize = BRICK_VOXELS / 64;

/// One bit per voxel of a brick, in Morton order.
pub(crate) type Mask = [u64; WORDS];

/// Whether a mask has the bit of a voxel.
#[inline]
pub(crate) fn has(mask: &Mask, voxel: usize) -> bool {
    mask[voxel / 64] >> (voxel % 64) & 1 != 0
}

/// Sets the bit of a voxel and says whether it was clear.
#[inline]
pub(crate) fn set(mask: &mut Mask, voxel: usize) -> bool {
    let bit = 1u64 << (voxel % 64);
    let was_clear = mask[voxel / 64] & bit == 0;
    mask[voxel / 64] |= bit;
    was_clear
}

/// Sets the bits of `length` voxels (1, 8 or 64, aligned) from `start` on.
#[inline]
pub(crate) fn set_range(mask: &mut Mask, start: usize, length: usize) {
    mask[start / 64] |= u64::MAX >> (64 - length) << (start % 64);
}

/// The bits of `length` voxels (a power of eight, at most 512) from `start` on.
#[inline]
pub(crate) fn range(start: usize, length: usize) -> Mask {
    std::array::from_fn(|word| {
        if length >= 64 {
            if (start..start + length).contains(&(word * 64)) { u64::MAX } else { 0 }
        } else if start / 64 == word {
            ((1 << length) - 1) << (start % 64)
        } else {
            0
        }
    })
}

/// A mask with these bits in one word.
pub(crate) fn word(word: usize, bits: u64) -> Mask {
    std::array::from_fn(|n| if n == word { bits } else { 0 })
}

/// The voxels of a brick (by its lowest key) that lie in a box of keys, both inclusive.
#[inline]
pub(crate) fn inside(corner: Key, min: Key, max: Key) -> Mask {
    // By axis: the voxels of a word in the lower and in the upper half of the brick.
    let halves: [[u64; 2]; 3] = std::array::from_fn(|axis| {
        let low = usize::from(min[axis].saturating_sub(corner[axis]).min(8));
        let high = (i32::from(max[axis]) - i32::from(corner[axis]) + 1).clamp(0, 8) as usize;
        let below = &BELOW[axis];
        [below[high.min(4)] & !below[low.min(4)], below[high.max(4) - 4] & !below[low.max(4) - 4]]
    });
    let [x, y, z] = halves;
    std::array::from_fn(|word| x[word & 1] & y[word >> 1 & 1] & z[word >> 2])
}

/// By axis and coordinate within a block of 4 x 4 x 4: those of its 64 voxels that are below the coordinate.
const BELOW: [[u64; 5]; 3] = {
    let mut below = [[0; 5]; 3];
    let mut voxel = 0;
    while voxel < 64 {
        let mut axis = 0;
        while axis < 3 {
            let mut above = ((voxel >> axis & 1) | (voxel >> (3 + axis) & 1) << 1) + 1;
            while above < 5 {
                below[axis][above] |= 1 << voxel;
                above += 1;
            }
            axis += 1;
        }
        voxel += 1;
    }
    below
};

/// Number of set bits.
#[inline]
pub(crate) fn count(mask: &Mask) -> usize {
    mask.iter().map(|word| word.count_ones() as usize).sum()
}

/// Bit n: a bit of word n is set.
#[inline]
pub(crate) fn words(mask: &Mask) -> u8 {
    mask.iter().enumerate().fold(0, |words, (n, word)| words | u8::from(*word != 0) << n)
}

/// Whether no bit is set.
#[inline]
pub(crate) fn is_empty(mask: &Mask) -> bool {
    mask.iter().fold(0, |all, word| all | word) == 0
}

/// The set bits of a mask, ascending.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bits {
    mask: Mask,
    word: usize,
}

impl Bits {
    pub(crate) fn of(mask: Mask) -> Self {
        Self { mask, word: 0 }
    }
}

impl Iterator for Bits {
    type Item = usize;

    #[inline]
    fn next(&mut self) -> Option<usize> {
        while let Some(word) = self.mask.get_mut(self.word) {
            if *word != 0 {
                let bit = word.trailing_zeros() as usize;
                *word &= *word - 1;
                return Some(self.word * 64 + bit);
            }
            self.word += 1;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::morton;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_box_cuts_a_brick_where_keys_say(
            min in prop::array::uniform3(90u16..115),
            size in prop::array::uniform3(0u16..20),
        ) {
            let max: Key = std::array::from_fn(|axis| min[axis] + size[axis]);
            let corner: Key = [96, 104, 96];
            let mask = inside(corner, min, max);
            for voxel in 0..BRICK_VOXELS {
                let key = morton::decode(morton::encode(corner) | voxel as u64);
                let expected = (0..3).all(|axis| (min[axis]..=max[axis]).contains(&key[axis]));
                prop_assert_eq!(has(&mask, voxel), expected);
            }
        }
    }

    #[test]
    fn a_range_holds_its_voxels_only() {
        for (start, length) in [(0, 512), (64, 64), (448, 64), (72, 8), (511, 1), (0, 1)] {
            let voxels: Vec<_> = Bits::of(range(start, length)).collect();
            assert_eq!(voxels, (start..start + length).collect::<Vec<_>>());
            assert_eq!(count(&range(start, length)), length);
            if length <= 64 {
                let mut mask = [0; WORDS];
                set_range(&mut mask, start, length);
                assert_eq!(mask, range(start, length));
            }
        }
    }
}

//! Small numbers of 512 voxels as bit planes: plane n holds the n-th bit of each voxel's number, so that all voxels of
//! one number are found, and changed, by a handful of word operations.

use crate::mask::{Mask, WORDS};
use crate::units::Unit;

/// The number of one voxel.
#[inline]
pub(crate) fn get(planes: &[Unit], voxel: usize) -> u16 {
    let (word, bit) = (voxel / 64, voxel % 64);
    planes.iter().enumerate().fold(0, |number, (n, plane)| number | ((plane[word] >> bit & 1) as u16) << n)
}

/// Gives the voxels of a word's `mask` one number.
#[inline]
pub(crate) fn put(planes: &mut [Unit], word: usize, mask: u64, number: u16) {
    for (n, plane) in planes.iter_mut().enumerate() {
        let bit = u64::from(number >> n & 1).wrapping_neg();
        plane[word] = plane[word] & !mask | mask & bit;
    }
}

/// The voxels whose number is not zero.
#[inline]
pub(crate) fn nonzero(planes: &[Unit]) -> Mask {
    let mut any = [0; WORDS];
    for plane in planes {
        any.iter_mut().zip(plane).for_each(|(any, plane)| *any |= plane);
    }
    any
}

/// The voxels with a number.
#[inline]
pub(crate) fn equal(planes: &[Unit], number: u16) -> Mask {
    let mut same = [u64::MAX; WORDS];
    for (n, plane) in planes.iter().enumerate() {
        let bit = u64::from(number >> n & 1).wrapping_neg();
        same.iter_mut().zip(plane).for_each(|(same, plane)| *same &= !(plane ^ bit));
    }
    same
}

/// The voxels among a word's `among` that have the same number as its lowest, and that number.
#[inline]
pub(crate) fn alike(planes: &[Unit], word: usize, among: u64) -> (u64, u16) {
    let (bit, mut same, mut number) = (among.trailing_zeros(), among, 0);
    for (n, plane) in planes.iter().enumerate() {
        let one = plane[word] >> bit & 1;
        number |= (one as u16) << n;
        same &= !(plane[word] ^ one.wrapping_neg());
    }
    (same, number)
}

/// The common number of all 512 voxels, if they have one.
#[inline]
pub(crate) fn uniform(planes: &[Unit]) -> Option<u16> {
    let mut number = 0;
    for (n, plane) in planes.iter().enumerate() {
        match plane[0] {
            0 => {}
            u64::MAX => number |= 1 << n,
            _ => return None,
        }
    }
    planes.iter().all(|plane| plane.iter().all(|word| *word == plane[0])).then_some(number)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mask::{BRICK_VOXELS, has};

    #[test]
    fn planes_hold_numbers() {
        let mut planes = [[0; 8]; 7];
        let number = |voxel: usize| (voxel * voxel % 100) as u16;
        for voxel in 0..BRICK_VOXELS {
            put(&mut planes, voxel / 64, 1 << (voxel % 64), number(voxel));
        }
        let (nonzero, equal) = (nonzero(&planes), equal(&planes, 44));
        for voxel in 0..BRICK_VOXELS {
            assert_eq!(get(&planes, voxel), number(voxel));
            assert_eq!(has(&nonzero, voxel), number(voxel) != 0);
            assert_eq!(has(&equal, voxel), number(voxel) == 44);
            let (word, bit) = (voxel / 64, voxel % 64);
            let (same, found) = alike(&planes, word, u64::MAX << bit);
            assert_eq!(found, number(voxel));
            for other in 0..64 {
                let expected = other >= bit && number(word * 64 + other) == found;
                assert_eq!(same >> other & 1 != 0, expected);
            }
        }
        assert_eq!(uniform(&planes), None);
        for word in 0..WORDS {
            put(&mut planes, word, u64::MAX, 77);
        }
        assert_eq!(uniform(&planes), Some(77));
    }
}

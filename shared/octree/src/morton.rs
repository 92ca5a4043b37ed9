//! Morton codes: the bits of x, y and z interleaved, x lowest. Their order is that of an octree's leaves, a code without
//! its last 9 bits names a brick, and those 9 bits a voxel in it.

use crate::Key;

/// Bits of a code that belong to each axis.
pub(crate) const AXES: [u64; 3] = [0x2492_4924_9249, 0x2492_4924_9249 << 1, 0x2492_4924_9249 << 2];

/// Low bits of a code that number a voxel within its brick.
pub(crate) const BRICK_BITS: u32 = 9;

/// The code of a voxel.
pub(crate) fn encode([x, y, z]: Key) -> u64 {
    spread(x) | spread(y) << 1 | spread(z) << 2
}

/// The low 9 bits of a code, by the low 3 bits of each axis.
#[inline]
pub(crate) fn within(key: Key) -> usize {
    const SPREAD: [u16; 8] = [0, 1, 8, 9, 64, 65, 72, 73];
    let [x, y, z] = key.map(|axis| SPREAD[usize::from(axis & 7)]);
    usize::from(x | y << 1 | z << 2)
}

/// The voxel of a code.
pub(crate) fn decode(code: u64) -> Key {
    [gather(code), gather(code >> 1), gather(code >> 2)]
}

/// Two zero bits after each bit.
fn spread(number: u16) -> u64 {
    let mut bits = u64::from(number);
    bits = (bits | bits << 16) & 0x0000_ff00_00ff;
    bits = (bits | bits << 8) & 0x00f0_0f00_f00f;
    bits = (bits | bits << 4) & 0x0c30_c30c_30c3;
    (bits | bits << 2) & AXES[0]
}

/// Every third bit.
fn gather(code: u64) -> u16 {
    let mut bits = code & AXES[0];
    bits = (bits | bits >> 2) & 0x0c30_c30c_30c3;
    bits = (bits | bits >> 4) & 0x00f0_0f00_f00f;
    bits = (bits | bits >> 8) & 0x0000_ff00_00ff;
    (bits | bits >> 16) as u16
}

/// One voxel along the axis of `mask` (of [`AXES`]). `delta` is that axis' lowest bit for a step forward, and all its bits (minus one in this
/// arithmetic) for a step back; the bits of the other axes carry over between and are put back.
#[inline]
pub(crate) fn step(code: u64, mask: u64, delta: u64) -> u64 {
    ((code | !mask).wrapping_add(delta) & mask) | (code & !mask)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_code_names_its_voxel_and_steps_to_its_neighbours(key in any::<[u16; 3]>(), axis in 0usize..3) {
            prop_assert_eq!(decode(encode(key)), key);
            let mut neighbour = key;
            neighbour[axis] = key[axis].wrapping_add(1);
            prop_assert_eq!(decode(step(encode(key), AXES[axis], 1 << axis)), neighbour);
            prop_assert_eq!(decode(step(encode(neighbour), AXES[axis], AXES[axis])), key);
        }
    }

    #[test]
    fn codes_follow_the_child_order_of_an_octree() {
        assert_eq!(encode([1, 0, 0]), 1);
        assert_eq!(encode([0, 1, 0]), 2);
        assert_eq!(encode([0, 0, 1]), 4);
        assert_eq!(encode([2, 0, 0]), 8);
        assert_eq!(encode([u16::MAX; 3]), (1 << 48) - 1);
    }
}

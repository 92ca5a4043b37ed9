//! The box that one scan reaches, numbered densely.

use crate::Key;
use crate::morton::{self, BRICK_BITS};
use crate::rays::Ray;

/// Most bits of a brick's number: a table of 16 MiB, a box of 4 million bricks.
const MAX_BITS: u32 = 22;

/// A box of bricks. The code of a voxel in it has the voxel's place in its brick in the low 9 bits, in Morton order, and
/// above them the brick's coordinates within the box side by side: small numbers that index a table, and still every
/// axis' bits apart from the others', so that a step along an axis is an addition.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Window {
    /// Brick coordinates of the lower corner.
    corner: [u16; 3],
    /// Where each axis' brick coordinate starts in a code.
    shift: [u32; 3],
    /// Bits of a code that belong to each axis.
    masks: [u64; 3],
    bits: u32,
}

impl Window {
    /// The box that holds all keys from `min` to `max`.
    pub(crate) fn new(min: Key, max: Key) -> Self {
        let corner = min.map(|axis| axis >> 3);
        let mut window = Self { corner, shift: [0; 3], masks: [0; 3], bits: 0 };
        for axis in 0..3 {
            let bricks = u32::from((max[axis] >> 3).saturating_sub(corner[axis])) + 1;
            let bits = bricks.next_power_of_two().trailing_zeros();
            window.shift[axis] = BRICK_BITS + window.bits;
            window.masks[axis] = spread(7) << axis | ((1 << bits) - 1) << window.shift[axis];
            window.bits += bits;
        }
        window
    }

    /// The box that the walks of rays stay in, with a margin in voxels: rounding may carry a walk past its end, as far as the
    /// ray's length reaches, into a neighbour of the end's voxel.
    pub(crate) fn around(origin: Key, rays: &[Ray], margin: u16) -> Self {
        let (mut min, mut max) = (origin, origin);
        for ray in rays {
            for axis in 0..3 {
                min[axis] = min[axis].min(ray.key[axis]);
                max[axis] = max[axis].max(ray.key[axis]);
            }
        }
        Self::new(min.map(|axis| axis.saturating_sub(margin)), max.map(|axis| axis.saturating_add(margin)))
    }

    /// Whether a voxel has a code.
    pub(crate) fn contains(&self, key: Key) -> bool {
        (0..3).all(|axis| {
            let brick = (key[axis] >> 3).checked_sub(self.corner[axis]);
            brick.is_some_and(|brick| u64::from(brick) <= self.masks[axis] >> self.shift[axis])
        })
    }

    /// Whether a table of all bricks is small enough.
    pub(crate) fn is_dense(&self) -> bool {
        self.bits <= MAX_BITS
    }

    /// Numbers of bricks: 0 up to this.
    pub(crate) fn bricks(&self) -> usize {
        1 << self.bits
    }

    pub(crate) fn masks(&self) -> [u64; 3] {
        self.masks
    }

    /// Code of a voxel in the box.
    #[inline]
    pub(crate) fn code(&self, key: Key) -> u64 {
        self.axis_code(key, 0) | self.axis_code(key, 1) | self.axis_code(key, 2)
    }

    /// The bits of a voxel's code that belong to one axis.
    #[inline]
    pub(crate) fn axis_code(&self, key: Key, axis: usize) -> u64 {
        let brick = (key[axis] >> 3).wrapping_sub(self.corner[axis]);
        spread(u64::from(key[axis] & 7)) << axis | u64::from(brick) << self.shift[axis]
    }

    /// What is added to an axis' bits, and masked, for one step.
    pub(crate) fn step(&self, axis: usize, forward: bool) -> u64 {
        // Forward the gaps are filled with ones over which the carry runs; back the borrow runs over zeros.
        if forward { self.masks[axis].wrapping_neg() } else { (1_u64 << axis).wrapping_neg() }
    }

    /// Morton code of a brick by its number.
    #[inline]
    pub(crate) fn brick_code(&self, number: u64) -> u64 {
        let key = std::array::from_fn(|axis| {
            let low = self.shift[axis] - BRICK_BITS;
            let coordinate = (number & (self.masks[axis] >> BRICK_BITS)) >> low;
            self.corner[axis] + coordinate as u16
        });
        morton::encode(key)
    }
}

/// Three bits to the places 0, 3 and 6.
#[inline]
fn spread(bits: u64) -> u64 {
    bits & 1 | (bits & 2) << 2 | (bits & 4) << 4
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn step(window: &Window, key: Key, axis: usize, forward: bool) -> u64 {
        let mut code = [0, 1, 2].map(|axis| window.axis_code(key, axis));
        code[axis] = code[axis].wrapping_add(window.step(axis, forward)) & window.masks()[axis];
        code[0] | code[1] | code[2]
    }

    proptest! {
        #[test]
        fn codes_step_as_keys_do_and_name_their_brick(
            min in prop::array::uniform3(0u16..60_000),
            size in prop::array::uniform3(1u16..5_000),
            place in prop::array::uniform3(0.0f64..1.0),
            axis in 0usize..3,
        ) {
            let max: Key = std::array::from_fn(|axis| min[axis] + size[axis]);
            let window = Window::new(min, max);
            let key: Key = std::array::from_fn(|axis| min[axis] + (place[axis] * f64::from(size[axis])) as u16);
            let code = window.code(key);
            prop_assert_eq!(window.brick_code(code >> 9) << 9 | code & 511, morton::encode(key));
            prop_assert!(code >> 9 < window.bricks() as u64);
            if key[axis] < max[axis] {
                let mut next = key;
                next[axis] += 1;
                prop_assert_eq!(step(&window, key, axis, true), window.code(next));
                prop_assert_eq!(step(&window, next, axis, false), code);
            }
        }
    }
}

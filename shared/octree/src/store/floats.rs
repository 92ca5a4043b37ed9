//! Bricks of plain values: the last resort where the palette has no numbers left.

use super::{FLOATS, Form, Store};
use crate::mask::{self, Mask, WORDS};
use crate::palette::{Palette, Update};

impl Store {
    /// Gives a brick plain values, because the palette has no numbers left.
    pub(crate) fn make_floats(&mut self, index: u32, palette: &Palette) {
        if matches!(self.slots[index as usize].form, Form::Floats(_)) {
            return;
        }
        let at = self.units.add(FLOATS);
        let mut values = [f32::NAN; mask::BRICK_VOXELS];
        self.for_each_value(index, palette, |word, voxels, value| {
            (0..64).filter(|bit| voxels >> bit & 1 != 0).for_each(|bit| values[word * 64 + bit] = value);
        });
        self.set_form(index, Form::Floats(at));
        for (voxel, value) in values.into_iter().enumerate() {
            self.set_float(at, voxel, value);
        }
    }

    pub(super) fn put_floats(&mut self, index: u32, mask: &Mask, value: f32) {
        if let Form::Floats(at) = self.slots[index as usize].form {
            mask::Bits::of(*mask).for_each(|voxel| self.set_float(at, voxel, value));
        }
    }

    pub(super) fn update_floats(
        &mut self,
        at: u32,
        (free, hit): (&Mask, &Mask),
        palette: &Palette,
        new: &mut Mask,
    ) -> Mask {
        let mut changed = [0; WORDS];
        for (mask, update) in [(free, Update::Miss), (hit, Update::Hit)] {
            for voxel in mask::Bits::of(*mask) {
                let value = self.float(at, voxel);
                let old = if value.is_nan() { 0.0 } else { value };
                let next = palette.updated(old, update);
                if value.is_nan() {
                    mask::set(new, voxel);
                }
                if value.is_nan() || next != old {
                    mask::set(&mut changed, voxel);
                    self.set_float(at, voxel, next);
                }
            }
        }
        changed
    }

    /// The value that all voxels have; `None` where one is unknown or they differ.
    #[cold]
    pub(super) fn common_float(&self, at: u32) -> Option<f32> {
        let first = self.float(at, 0);
        (1..mask::BRICK_VOXELS).all(|voxel| self.float(at, voxel) == first).then_some(first)
    }

    pub(super) fn float(&self, at: u32, voxel: usize) -> f32 {
        let word = self.units.run(at, FLOATS)[voxel / 16][voxel / 2 % 8];
        f32::from_bits((word >> (32 * (voxel % 2))) as u32)
    }

    pub(super) fn set_float(&mut self, at: u32, voxel: usize, value: f32) {
        let (word, shift) =
            (&mut self.units.run_mut(at, FLOATS)[voxel / 16][voxel / 2 % 8], 32 * (voxel % 2));
        *word = *word & !(0xffff_ffff << shift) | u64::from(value.to_bits()) << shift;
    }
}

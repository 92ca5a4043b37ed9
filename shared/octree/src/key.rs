//! Coordinates and keys.

/// An OctoMap key: `floor(coordinate / resolution) + 32768` per axis.
pub type Key = [u16; 3];

/// Key of the voxel whose lower corner is coordinate zero.
const OFFSET: f64 = 32768.0;

/// How coordinates map to keys. Coordinates are `f32` metres in the map frame, arithmetic is `f64`, as in OctoMap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeySpace {
    resolution: f64,
    /// OctoMap multiplies by the reciprocal; dividing would round differently.
    voxels_per_metre: f64,
}

impl KeySpace {
    /// Voxels with an edge of `resolution` metres, or `None` where that is no length from 0.1 mm to 1 km.
    pub fn new(resolution: f64) -> Option<Self> {
        (1e-4..=1e3).contains(&resolution).then(|| Self { resolution, voxels_per_metre: 1.0 / resolution })
    }

    /// Edge of a voxel, metres.
    pub fn resolution(&self) -> f64 {
        self.resolution
    }

    /// The voxel that holds a point; `None` where the point is not finite or beyond the 65536 voxels a side.
    #[inline]
    pub fn key(&self, point: [f32; 3]) -> Option<Key> {
        let [x, y, z] = point;
        Some([self.axis_key(x)?, self.axis_key(y)?, self.axis_key(z)?])
    }

    /// Centre of a voxel, metres.
    pub fn centre(&self, key: Key) -> [f64; 3] {
        key.map(|axis| self.axis_centre(axis))
    }

    /// Calls `visit` with every voxel that the ray from `origin` to `end` (metres) passes through, from the one that
    /// holds the origin up to, but without, the one that holds the end; with none where both are in one voxel. The same
    /// voxels in the same order as OctoMap's `computeRayKeys`. Says `false`, and visits none, where either end has no
    /// [`Self::key`].
    pub fn trace(&self, origin: [f32; 3], end: [f32; 3], mut visit: impl FnMut(Key)) -> bool {
        crate::trace::trace(self, origin, end, |code| visit(crate::morton::decode(code))).is_some()
    }

    /// The key nearest to a point that may lie outside; zero for NaN.
    pub(crate) fn nearest_key(&self, point: [f32; 3]) -> Key {
        // A float cast saturates.
        point.map(|c| ((self.voxels_per_metre * f64::from(c)).floor() + OFFSET) as u16)
    }

    #[inline]
    pub(crate) fn axis_centre(&self, key: u16) -> f64 {
        (f64::from(key) - OFFSET + 0.5) * self.resolution
    }

    #[inline]
    fn axis_key(&self, coordinate: f32) -> Option<u16> {
        let voxels = self.voxels_per_metre * f64::from(coordinate);
        // NaN is in no range.
        if !(-OFFSET..OFFSET).contains(&voxels) {
            return None;
        }
        // The floor without a call or a conversion: at this size the last bit of a double is worth 1, so that the sum is rounded
        // to a whole number, whose low bits are its low bits.
        const SIZE: f64 = 6_755_399_441_055_744.0; // 1.5 x 2^52
        let rounded = voxels + (SIZE + OFFSET);
        let is_above = rounded - (SIZE + OFFSET) > voxels;
        Some((rounded.to_bits() as u16).wrapping_sub(is_above.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_key_counts_whole_voxels_from_the_corner_of_the_space(
            point in prop::array::uniform3(-3300.0_f32..3300.0),
            whole in -40_000_i32..40_000,
        ) {
            // Also just beside the faces of voxels, where the product may be rounded across.
            let face = (f64::from(whole) * 0.1) as f32;
            let space = KeySpace::new(0.1).unwrap();
            for c in point.into_iter().chain([face.next_down(), face, face.next_up()]) {
                let floor = (1.0 / 0.1 * f64::from(c)).floor() + OFFSET;
                let expected = (0.0..2.0 * OFFSET).contains(&floor).then_some(floor as u16);
                prop_assert_eq!(space.key([c, 0.0, 0.0]), expected.map(|key| [key, 32768, 32768]), "{}", c);
            }
        }
    }

    #[test]
    fn points_without_a_voxel_have_no_key() {
        let space = KeySpace::new(0.1).unwrap();
        assert_eq!(space.key([0.05, -0.05, 0.0]), Some([32768, 32767, 32768]));
        assert_eq!(space.key([3276.75, -3276.75, 0.0]), Some([65535, 0, 32768]));
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 3276.9, -3276.9, f32::MAX] {
            assert_eq!(space.key([0.0, bad, 0.0]), None);
        }
    }

    #[test]
    fn a_resolution_is_a_length() {
        for bad in [0.0, -0.1, f64::NAN, f64::INFINITY, 1e-5] {
            assert!(KeySpace::new(bad).is_none());
        }
    }
}

//! How high the sensor is carried.

use std::collections::BTreeMap;

use rustc_hash::FxHashMap;

use crate::raster::Place;

/// The sensor is held between these heights, metres.
const HEIGHTS_M: [f64; 2] = [0.15, 3.0];
/// Heights that are told apart, metres: finer would change with every step.
const BIN_M: f64 = 0.05;
/// Visits of blocks with ground below that suffice to trust the median: a metre and a half of way.
const MIN_SAMPLES: u32 = 3;

/// Median height of the path above the ground seen below it.
#[derive(Debug, Default)]
pub(crate) struct SensorHeight {
    by_block: FxHashMap<Place, Vec<i32>>,
    bins: BTreeMap<i32, u32>,
    samples: u32,
}

impl SensorHeight {
    /// Measures anew in one block: the path's heights and the ground's surfaces in it, metres.
    pub(crate) fn update(&mut self, block: Place, path: impl Iterator<Item = f64>, surfaces: &[f64]) {
        let [low, high] = HEIGHTS_M;
        let mut path = path.peekable();
        if path.peek().is_none() {
            return;
        }
        let samples = self.by_block.entry(block).or_default();
        for bin in samples.drain(..) {
            self.samples -= 1;
            if let Some(count) = self.bins.get_mut(&bin) {
                *count -= 1;
            }
        }
        for height in path {
            let above = surfaces.iter().map(|surface| height - surface).filter(|above| *above >= low);
            let above = above.fold(f64::INFINITY, f64::min);
            if above <= high {
                samples.push((above / BIN_M).floor() as i32);
            }
        }
        for bin in samples {
            *self.bins.entry(*bin).or_default() += 1;
            self.samples += 1;
        }
    }

    /// Metres; `None` until enough ground was seen under the path.
    pub(crate) fn median(&self) -> Option<f64> {
        let mut left = (self.samples >= MIN_SAMPLES).then_some(self.samples.div_ceil(2))?;
        for (bin, count) in &self.bins {
            if *count >= left {
                return Some((f64::from(*bin) + 0.5) * BIN_M);
            }
            left -= count;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_height_is_that_above_the_ground_right_below_and_follows_what_is_seen_later() {
        let mut height = SensorHeight::default();
        for x in 0..5 {
            height.update([x, 0], [1.22].into_iter(), &[-3.0, 0.0]);
        }
        assert!((height.median().unwrap() - 1.225).abs() < 1e-9);
        for x in 0..5 {
            height.update([x, 0], [1.22].into_iter(), &[-3.0, -0.1]);
        }
        assert!((height.median().unwrap() - 1.325).abs() < 1e-9);
        (1..5).for_each(|x| height.update([x, 0], [1.22].into_iter(), &[]));
        assert_eq!(height.median(), None, "one block is not enough");
    }
}

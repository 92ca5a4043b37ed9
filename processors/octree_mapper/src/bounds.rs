//! Conditional filter (paper section 3.1, filter 2).

use crate::BoundsConfig;

impl BoundsConfig {
    /// Whether a point at `range` metres from the sensor is kept.
    pub fn keeps_range(&self, range: f32) -> bool {
        (self.min_range_m..=self.max_range_m).contains(&f64::from(range))
    }

    /// Whether a point in the map frame is kept.
    pub fn keeps_place(&self, point: [f32; 3]) -> bool {
        [self.x_m, self.y_m, self.z_m]
            .iter()
            .zip(point)
            .all(|(limits, value)| limits.is_none_or(|[low, high]| (low..=high).contains(&f64::from(value))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_axis_and_the_range_are_limited_on_their_own() {
        let free = BoundsConfig::default();
        assert!(free.keeps_place([1e6, -1e6, 1e6]));
        assert!(free.keeps_range(0.5) && !free.keeps_range(0.4) && !free.keeps_range(101.0));
        let band = BoundsConfig { z_m: Some([-2.0, 1.0]), x_m: Some([0.0, 5.0]), ..free };
        assert!(band.keeps_place([5.0, 77.0, -2.0]));
        assert!(!band.keeps_place([5.1, 0.0, 0.0]));
        assert!(!band.keeps_place([1.0, 0.0, 1.1]));
    }
}

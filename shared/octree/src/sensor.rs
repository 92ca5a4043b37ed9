//! The inverse sensor model and its arithmetic.

use evac_formats::octomap::BinaryValues;

use crate::MapError;

/// What is known of a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occupancy {
    /// No ray went through it or ended in it.
    Unknown,
    /// Below the threshold.
    Free,
    /// At or above the threshold.
    Occupied,
}

/// A sensor model in probabilities, as configuration files give it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probabilities {
    /// P(n | z) of a voxel in which a ray ends.
    pub hit: f64,
    /// P(n | z) of a voxel through which a ray passes.
    pub miss: f64,
    /// Lower bound of P(n | z_1:t).
    pub clamp_min: f64,
    /// Upper bound of P(n | z_1:t).
    pub clamp_max: f64,
    /// A voxel is occupied from this probability on.
    pub occupied: f64,
}

impl Default for Probabilities {
    /// OctoMap's.
    fn default() -> Self {
        Self { hit: 0.7, miss: 0.4, clamp_min: 0.1192, clamp_max: 0.971, occupied: 0.5 }
    }
}

/// A sensor model in log-odds.
///
/// With L(n) = ln(P(n) / (1 - P(n))) (the paper's Eq. 8) the recursive Bayes filter of Eq. 7 with a prior of 0.5
/// becomes the sum L(n | z_1:t) = L(n | z_1:t-1) + L(n | z_t) (Eq. 9), where L(n | z_t) is [`Self::hit`] for the voxel
/// in which a ray ends and [`Self::miss`] for those it passes. The sum is clamped to
/// [[`Self::clamp_min`], [`Self::clamp_max`]] (Eq. 10), so that a map follows a change after a bounded number of scans
/// and equal neighbours can be merged. All in `f32`, rounded as OctoMap rounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorModel {
    /// Added for a ray that ends in the voxel; positive.
    pub hit: f32,
    /// Added for a ray that passes through; negative.
    pub miss: f32,
    /// Least log-odds.
    pub clamp_min: f32,
    /// Greatest log-odds.
    pub clamp_max: f32,
    /// A voxel is occupied from here on.
    pub occupied: f32,
}

impl Default for SensorModel {
    /// OctoMap's: probabilities 0.7, 0.4, 0.1192, 0.971 and 0.5.
    fn default() -> Self {
        let Probabilities { hit, miss, clamp_min, clamp_max, occupied } = Probabilities::default();
        Self {
            hit: log_odds(hit),
            miss: log_odds(miss),
            clamp_min: log_odds(clamp_min),
            clamp_max: log_odds(clamp_max),
            occupied: log_odds(occupied),
        }
    }
}

impl SensorModel {
    /// The model in log-odds.
    ///
    /// # Errors
    /// [`MapError::Probability`] where a value is no probability, a hit would clear, a miss occupy, or the clamps
    /// exclude the 0.5 of an unknown voxel.
    pub fn from_probabilities(model: &Probabilities) -> Result<Self, MapError> {
        let Probabilities { hit, miss, clamp_min, clamp_max, occupied } = *model;
        let checks = [
            ("hit", hit, hit > 0.5 && hit < 1.0),
            ("miss", miss, miss > 0.0 && miss < 0.5),
            ("clamp_min", clamp_min, clamp_min > 0.0 && clamp_min < 0.5),
            ("clamp_max", clamp_max, clamp_max > 0.5 && clamp_max < 1.0),
            ("occupied", occupied, occupied > 0.0 && occupied < 1.0),
        ];
        if let Some(&(name, value, _)) = checks.iter().find(|(_, _, holds)| !holds) {
            return Err(MapError::Probability { name, value });
        }
        Ok(Self {
            hit: log_odds(hit),
            miss: log_odds(miss),
            clamp_min: log_odds(clamp_min),
            clamp_max: log_odds(clamp_max),
            occupied: log_odds(occupied),
        })
    }

    /// Whether a voxel of this value is occupied.
    #[inline]
    pub fn is_occupied(&self, log_odds: f32) -> bool {
        log_odds >= self.occupied
    }

    /// Whether its values are finite and on their sides of an unknown voxel's zero: what a map needs so that no voxel ever gets another value.
    pub(crate) fn is_valid(&self) -> bool {
        let Self { hit, miss, clamp_min, clamp_max, occupied } = *self;
        [hit, miss, clamp_min, clamp_max, occupied].iter().all(|value| value.is_finite())
            && hit > 0.0
            && miss < 0.0
            && clamp_min < 0.0
            && clamp_max > 0.0
    }

    /// The values that a `.bt` file written from this model's map stands for.
    pub fn binary_values(&self) -> BinaryValues {
        BinaryValues { free: self.clamp_min, occupied: self.clamp_max, threshold: self.occupied }
    }

    /// The value of a voxel after a ray has ended in it. A value at or beyond the clamp stays as it is, also where it
    /// was set from outside. Zero is an unknown voxel's.
    #[inline]
    pub(crate) fn struck(&self, log_odds: f32) -> f32 {
        let sum = self.clamped(log_odds + self.hit);
        if log_odds >= self.clamp_max { log_odds } else { sum }
    }

    /// The same after a ray has passed through it.
    #[inline]
    pub(crate) fn missed(&self, log_odds: f32) -> f32 {
        let sum = self.clamped(log_odds + self.miss);
        if log_odds <= self.clamp_min { log_odds } else { sum }
    }

    /// Selections rather than branches: which voxels are at a clamp is hard to predict.
    #[inline]
    pub(crate) fn clamped(&self, log_odds: f32) -> f32 {
        let raised = if log_odds < self.clamp_min { self.clamp_min } else { log_odds };
        if raised > self.clamp_max { self.clamp_max } else { raised }
    }
}

/// L = ln(P / (1 - P)), computed in `f64` and rounded once.
fn log_odds(probability: f64) -> f32 {
    (probability / (1.0 - probability)).ln() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_log_odds_are_octomaps_to_the_last_bit() {
        let model = SensorModel::default();
        let bits =
            [model.hit, model.miss, model.clamp_min, model.clamp_max, model.occupied].map(f32::to_bits);
        // 0.847297847, -0.405465096, -2.00002789, 3.51103067 and 0.
        assert_eq!(bits, [1_062_791_299, 3_201_276_191, 3_221_225_589, 1_080_079_546, 0]);
        assert_eq!(model.binary_values(), BinaryValues::default());
        assert_eq!(SensorModel::from_probabilities(&Probabilities::default()), Ok(model));
    }

    #[test]
    fn a_model_that_cannot_be_meant_is_refused_by_name() {
        let good = Probabilities::default();
        let cases = [
            (Probabilities { hit: 0.4, ..good }, "hit"),
            (Probabilities { miss: 0.6, ..good }, "miss"),
            (Probabilities { clamp_min: 0.98, ..good }, "clamp_min"),
            (Probabilities { clamp_max: 1.0, ..good }, "clamp_max"),
            (Probabilities { occupied: f64::NAN, ..good }, "occupied"),
        ];
        for (model, expected) in cases {
            let refusal = SensorModel::from_probabilities(&model);
            assert!(matches!(refusal, Err(MapError::Probability { name, .. }) if name == expected));
        }
    }

    #[test]
    fn a_clamped_voxel_changes_its_mind_after_a_bounded_number_of_scans() {
        let model = SensorModel::default();
        let mut value = model.struck(0.0);
        for _ in 0..1000 {
            value = model.struck(value);
        }
        assert_eq!(value, model.clamp_max);
        let misses = (1..).find(|_| {
            value = model.missed(value);
            !model.is_occupied(value)
        });
        assert_eq!(misses, Some(9));
    }
}

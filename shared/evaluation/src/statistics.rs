//! Figures of a list of errors.

use serde::Serialize;

/// Statistics of errors that are not negative, as evo names and computes them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Statistics {
    /// Root of the mean square.
    pub rmse: f64,
    /// Arithmetic mean.
    pub mean: f64,
    /// Middle value; of an even number the mean of the middle two.
    pub median: f64,
    /// Standard deviation of the population (divided by n).
    pub std: f64,
    /// Largest.
    pub max: f64,
}

impl Statistics {
    /// `None` of no errors.
    pub fn of(errors: &[f64]) -> Option<Self> {
        let mean = mean(errors)?;
        let n = errors.len() as f64;
        Some(Self {
            rmse: (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt(),
            mean,
            median: median(errors)?,
            std: (squared_deviations(errors, mean) / n).sqrt(),
            max: errors.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        })
    }
}

pub(crate) fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// In two passes: heights far from zero that differ little keep their digits.
pub(crate) fn squared_deviations(values: &[f64], mean: f64) -> f64 {
    values.iter().map(|value| (value - mean).powi(2)).sum()
}

pub(crate) fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let upper = *sorted.get(sorted.len() / 2)?;
    if sorted.len() % 2 == 1 {
        return Some(upper);
    }
    let lower = *sorted.get((sorted.len() / 2).checked_sub(1)?)?;
    Some(f64::midpoint(lower, upper))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_four_errors_are_those_of_a_pocket_calculator() {
        let statistics = Statistics::of(&[4.0, 1.0, 3.0, 2.0]).unwrap();
        assert_eq!(statistics.mean, 2.5);
        assert_eq!(statistics.median, 2.5);
        assert_eq!(statistics.max, 4.0);
        assert_eq!(statistics.rmse, 7.5_f64.sqrt());
        assert_eq!(statistics.std, 1.25_f64.sqrt());
    }

    #[test]
    fn the_median_of_an_odd_number_is_the_middle_one() {
        assert_eq!(median(&[9.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&[]), None);
        assert!(Statistics::of(&[]).is_none());
    }
}

//! The ten figures of the paper's Table 1.

use serde::Serialize;

use crate::statistics::{mean, median, squared_deviations};

/// The figures that the paper gives of its z coordinates, metres.
///
/// Its numbers agree with these formulas: the standard deviation is the sample's (n - 1), "dispersion" its square,
/// the standard error the deviation over the root of n, and the total n times the average.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figures {
    /// Arithmetic mean.
    pub average: f64,
    /// Standard error of the average: standard deviation / sqrt(number).
    pub standard_error: f64,
    /// Middle value; of an even number the mean of the middle two.
    pub median: f64,
    /// Standard deviation of the sample (n - 1).
    pub standard_deviation: f64,
    /// Variance of the sample, square metres.
    pub dispersion: f64,
    /// Maximum - minimum.
    pub range: f64,
    /// Smallest.
    pub minimum: f64,
    /// Largest.
    pub maximum: f64,
    /// Sum.
    pub total: f64,
    /// How many values.
    pub number: usize,
}

impl Figures {
    /// `None` of fewer than two values, which have no standard deviation.
    pub fn of(values: &[f64]) -> Option<Self> {
        if values.len() < 2 {
            return None;
        }
        let average = mean(values)?;
        let n = values.len() as f64;
        let dispersion = squared_deviations(values, average) / (n - 1.0);
        let minimum = values.iter().copied().fold(f64::INFINITY, f64::min);
        let maximum = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Some(Self {
            average,
            standard_error: (dispersion / n).sqrt(),
            median: median(values)?,
            standard_deviation: dispersion.sqrt(),
            dispersion,
            range: maximum - minimum,
            minimum,
            maximum,
            total: values.iter().sum(),
            number: values.len(),
        })
    }

    /// Names, in the paper's words and order, and values.
    pub fn rows(&self) -> [(&'static str, f64); 10] {
        [
            ("average", self.average),
            ("standard error", self.standard_error),
            ("median", self.median),
            ("standard deviation", self.standard_deviation),
            ("dispersion", self.dispersion),
            ("range", self.range),
            ("minimum", self.minimum),
            ("maximum", self.maximum),
            ("total", self.total),
            ("number", self.number as f64),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A column of the paper's Table 1, in its order.
    type Column = [f64; 10];
    const OUR_METHOD: Column =
        [0.306158, 0.012987, 0.35587, 0.194372, 0.037781, 0.72491, -0.08432, 0.640587, 68.57932, 224.0];
    const LOAM_LIVOX: Column =
        [-3.8111, 0.2772, -2.29935, 4.148744, 17.21208, 12.36419, -11.9262, 0.437986, -853.686, 224.0];

    /// A series with the average, deviation (of n - 1), median, minimum, maximum and number of a column: one value at each
    /// end, two at the median and the rest at two values that make the first two moments right.
    fn series(column: &Column) -> Vec<f64> {
        let [average, _, median, deviation, _, _, minimum, maximum, _, number] = *column;
        let fixed = [minimum, median, median, maximum];
        let half = (number - 4.0) / 2.0;
        let sum = (number * average - fixed.iter().sum::<f64>()) / half;
        let squares = (number - 1.0) * deviation * deviation + number * average * average
            - fixed.iter().map(|v| v * v).sum::<f64>();
        let apart = (2.0 * squares / half - sum * sum).sqrt();
        let (low, high) = ((sum - apart) / 2.0, (sum + apart) / 2.0);
        assert!(minimum < low && low < median && median < high && high < maximum, "{low} {high}");
        let rest = (0..half as usize).flat_map(|_| [low, high]);
        fixed.into_iter().chain(rest).collect()
    }

    #[test]
    fn both_columns_of_the_papers_table_1_follow_from_their_first_moments_and_extremes() {
        for column in [OUR_METHOD, LOAM_LIVOX] {
            let figures = Figures::of(&series(&column)).unwrap();
            for ((name, value), paper) in figures.rows().into_iter().zip(column) {
                // Five to seven digits are printed.
                assert!((value - paper).abs() <= 3e-5 * paper.abs(), "{name}: {value}, not {paper}");
            }
        }
    }

    #[test]
    fn the_deviation_is_that_of_a_sample() {
        let figures = Figures::of(&[1.0, 2.0, 3.0, 4.0]).unwrap();
        assert_eq!(figures.dispersion, 5.0 / 3.0);
        assert_eq!(figures.standard_error, (5.0_f64 / 12.0).sqrt());
        assert_eq!(Figures::of(&[1.0]), None);
    }
}

//! Round numbers along an axis.

/// Multiples of 1, 2 or 5 times a power of ten within `low..=high`, `wanted` of them or fewer, and how they are written.
pub(crate) fn ticks([low, high]: [f64; 2], wanted: f64) -> Vec<(f64, String)> {
    let step = round_up((high - low) / wanted.max(1.0));
    if !(step.is_finite() && step > 0.0) {
        return Vec::new();
    }
    let decimals = (-step.log10().floor()).clamp(0.0, 12.0) as usize;
    let (first, last) = ((low / step - 1e-9).ceil(), (high / step + 1e-9).floor());
    // Far from zero the step may be lost to rounding; so many ticks nobody asked for.
    let count = (last - first).clamp(-1.0, 1000.0) as i64;
    // Adding 0 turns -0 into 0.
    (0..=count)
        .map(|i| (first + i as f64) * step + 0.0)
        .map(|tick| (tick, format!("{tick:.decimals$}")))
        .collect()
}

/// The least of 1, 2 and 5 times a power of ten that is not less than `value`.
pub(crate) fn round_up(value: f64) -> f64 {
    let decade = 10f64.powf(value.log10().floor());
    let step = [1.0, 2.0, 5.0].into_iter().find(|step| step * decade >= value * (1.0 - 1e-9));
    step.unwrap_or(10.0) * decade
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(range: [f64; 2], wanted: f64) -> Vec<String> {
        ticks(range, wanted).into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round_and_written_with_the_decimals_they_need() {
        assert_eq!(labels([-0.4, 10.2], 6.0), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(labels([-0.03, 0.05], 5.0), ["-0.02", "0.00", "0.02", "0.04"]);
        assert_eq!(labels([0.0, 1.0], 5.0), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels([1190.0, 3700.0], 3.0), ["2000", "3000"]);
    }

    #[test]
    fn no_range_gives_endless_ticks() {
        for range in [[0.0, 0.0], [1.0, f64::INFINITY], [f64::NAN, 1.0], [1e300, 1e308], [1e17, 1e17 + 64.0]]
        {
            assert!(ticks(range, 8.0).len() <= 1001, "{range:?}");
        }
    }

    #[test]
    fn round_lengths_are_one_two_or_five_of_a_decade() {
        assert_eq!([0.3, 1.0, 1.1, 21.0, 70.0].map(round_up), [0.5, 1.0, 2.0, 50.0, 100.0]);
    }
}

//! The sentence about a configuration value that is out of range.

/// Refuses a value outside `low..=high`, NaN included; `hint` says what to try.
///
/// # Errors
/// One sentence naming the key, its value and the range, for [`crate::StageConfig::check`].
pub fn check_range(key: &str, value: f64, low: f64, high: f64, hint: &str) -> Result<(), String> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(format!("{key} = {value} must lie between {low} and {high}; {hint}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_that_is_not_a_number_is_outside_every_range() {
        assert!(check_range("a", 1.0, 1.0, 2.0, "x").is_ok());
        for value in [0.999, 2.001, f64::NAN, f64::INFINITY] {
            assert!(check_range("a", value, 1.0, 2.0, "x").unwrap_err().contains("a = "));
        }
    }
}

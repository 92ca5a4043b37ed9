//! Sentences about values that do not fit.

/// Refuses what is not a positive finite number.
pub(crate) fn positive(key: &str, value: f64, hint: &str) -> Result<(), String> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(format!("{key} = {value} must be a positive number; {hint}"))
}

/// Refuses a pair that is not in ascending order.
pub(crate) fn range(key: &str, [low, high]: [f64; 2]) -> Result<(), String> {
    if low < high {
        return Ok(());
    }
    Err(format!("{key} = [{low}, {high}] must be two numbers, the lower one first"))
}

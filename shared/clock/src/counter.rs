//! Counters that start again at 0.

/// Follows a counter through its wraps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Counter {
    modulus: Option<u64>,
    tick_ns: f64,
    /// The newest value that was accepted, with its place on the unwrapped line and its arrival.
    last: Option<(u64, i64, i64)>,
}

impl Counter {
    pub(crate) fn new(modulus: Option<u64>, tick_ns: f64) -> Self {
        Self { modulus: modulus.filter(|modulus| *modulus > 1), tick_ns, last: None }
    }

    /// Where `ticks`, which arrived at `host_ns`, lies on a line without wraps; the first value lies at 0.
    pub(crate) fn place(&self, ticks: u64, host_ns: i64) -> i64 {
        let Some((last, place, last_host_ns)) = self.last else { return 0 };
        let Some(modulus) = self.modulus else {
            return place.saturating_add(ticks.wrapping_sub(last).cast_signed());
        };
        let ahead = (i128::from(ticks) - i128::from(last)).rem_euclid(i128::from(modulus));
        // As many wraps as bring the counter next to what the host's clock says has passed.
        let elapsed = host_ns.saturating_sub(last_host_ns) as f64 / self.tick_ns;
        let wraps = ((elapsed - ahead as f64) / modulus as f64).round() as i128;
        let passed = ahead.saturating_add(wraps.saturating_mul(i128::from(modulus)));
        place.saturating_add(i64::try_from(passed).unwrap_or(i64::MAX))
    }

    /// Takes `ticks` as the newest value.
    pub(crate) fn accept(&mut self, ticks: u64, place: i64, host_ns: i64) {
        self.last = Some((ticks, place, host_ns));
    }

    /// Forgets where it was: the next value lies at 0.
    pub(crate) fn restart(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counter_of_one_second_is_followed_through_a_silence_of_many() {
        // Nanoseconds since the last pulse, as of a device with PPS only.
        let mut counter = Counter::new(Some(1_000_000_000), 1.0);
        counter.accept(900_000_000, 0, 0);
        assert_eq!(counter.place(100_000_000, 210_000_000), 200_000_000);
        assert_eq!(counter.place(100_000_000, 7_190_000_000), 7_200_000_000);
        // A packet that comes twice lies behind, not a second ahead.
        assert_eq!(counter.place(890_000_000, 1_000_000), -10_000_000);
    }

    #[test]
    fn a_counter_without_wraps_may_be_anywhere() {
        let mut counter = Counter::new(None, 1.0);
        assert_eq!(counter.place(u64::MAX, 5), 0);
        counter.accept(u64::MAX, 0, 5);
        assert_eq!(counter.place(9, 6), 10);
        assert_eq!(counter.place(u64::MAX - 3, 6), -3);
    }
}

//! What is known about a device's clock beforehand.

/// What is known about a device's clock and about the way that its data takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Nominal nanoseconds of one tick.
    pub tick_ns: f64,
    /// The counter starts again at 0 after this many ticks; `None` where it never does.
    pub modulus: Option<u64>,
    /// How far the clock's rate may be off its nominal one, parts per million, one sigma.
    pub tolerance_ppm: f64,
    /// Arrivals up to this long ago count, nanoseconds. Longer than the beat between the sampling and a USB adapter's latency timer
    /// (12.5 s for 5.0004 ms and 1 ms), shorter than a temperature takes to change an oscillator.
    pub window_ns: i64,
    /// Stamps are withheld at a segment's start until arrivals of this long have been seen, nanoseconds: until then the
    /// envelope still falls.
    pub settle_ns: i64,
    /// A clock that jumps by more has been set, nanoseconds. Longer than any delay that varies.
    pub step_ns: i64,
    /// Arrivals earlier than the envelope by more mean the same, once the envelope is known, nanoseconds: data comes late, never
    /// early. Larger than what the envelope itself is rough by.
    pub early_ns: i64,
    /// Arrivals that are all later than this for `confirm_ns` mean that the counter has lost ticks, nanoseconds.
    pub shift_ns: i64,
    /// See `shift_ns`; nanoseconds of the host's clock.
    pub confirm_ns: i64,
}

impl Settings {
    /// A counter of `tick_ns` nanoseconds that runs by a quartz.
    pub fn counter(tick_ns: f64) -> Self {
        Self {
            tick_ns,
            modulus: None,
            tolerance_ppm: 100.0,
            window_ns: 32_000_000_000,
            settle_ns: 500_000_000,
            step_ns: 100_000_000,
            early_ns: 2_000_000,
            shift_ns: 5_000_000,
            confirm_ns: 1_000_000_000,
        }
    }

    /// Samples that are counted, at a nominal rate that may be half a percent off. A lost sample that the count does not
    /// know of shows as a shift by one period.
    pub fn samples(rate_hz: f64) -> Self {
        let tick_ns = 1e9 / rate_hz;
        Self {
            tolerance_ppm: 5000.0,
            // An index that is ahead was counted wrongly; a line that was laid with a wrong rate is early too.
            early_ns: 100_000_000,
            shift_ns: (tick_ns / 2.0) as i64,
            // The rate is looked for at the same time.
            settle_ns: 1_500_000_000,
            // Longer than the beat with a latency timer, within which arrivals may all be late by a period.
            confirm_ns: 20_000_000_000,
            ..Self::counter(tick_ns)
        }
    }
}

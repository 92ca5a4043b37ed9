//! What the benches share.

use std::fmt;

/// Whether this is a trial run (`cargo bench -- --test`), whose figures mean nothing; criterion decides in the same way.
pub(crate) fn is_trial() -> bool {
    let given = |wanted: &str| std::env::args().any(|argument| argument == wanted);
    given("--test") || !given("--bench")
}

/// Every time that was measured in one case.
#[derive(Debug, Default)]
pub(crate) struct Distribution {
    nanoseconds: Vec<i64>,
}

impl Distribution {
    pub(crate) fn record(&mut self, nanoseconds: i64) {
        self.nanoseconds.push(nanoseconds);
    }

    /// Median, 99th percentile and maximum; `None` where nothing was measured, for example because of a filter on the
    /// command line.
    pub(crate) fn summary(&self) -> Option<Summary> {
        let mut sorted = self.nanoseconds.clone();
        sorted.sort_unstable();
        let at = |share: f64| {
            let rank = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.saturating_sub(1)).map(|nanoseconds| *nanoseconds as f64 * 1e-3)
        };
        Some(Summary { p50_us: at(0.5)?, p99_us: at(0.99)?, max_us: at(1.0)?, count: sorted.len() })
    }
}

/// Percentiles by nearest rank, microseconds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Summary {
    pub(crate) p50_us: f64,
    pub(crate) p99_us: f64,
    pub(crate) max_us: f64,
    pub(crate) count: usize,
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:>10.1} {:>10.1} {:>10.1} {:>8}", self.p50_us, self.p99_us, self.max_us, self.count)
    }
}

/// Prints the line above a table of [`Summary`] rows.
pub(crate) fn print_heading(title: &str) {
    let note = if is_trial() { " (trial run: the figures mean nothing)" } else { "" };
    println!("\n{title}{note}");
    println!("{:<34} {:>10} {:>10} {:>10} {:>8}", "microseconds", "p50", "p99", "max", "count");
}

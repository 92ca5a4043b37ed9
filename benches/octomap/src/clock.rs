//! Processor time, which says nearly the same on a busy machine and an idle one.

use rustix::time::{ClockId, clock_gettime};

/// Milliseconds of processor time that this thread has had.
pub(crate) fn thread_ms() -> f64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as f64 * 1e3 + now.tv_nsec as f64 * 1e-6
}

/// Upper median; NaN of nothing.
pub(crate) fn median(times: &[f64]) -> f64 {
    let mut sorted = times.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

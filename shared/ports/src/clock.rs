//! The host's monotonic clock, the one that all processes of a machine share.

use rustix::time::{ClockId, clock_gettime};

/// Nanoseconds of `CLOCK_MONOTONIC`.
pub fn now_ns() -> i64 {
    let time = clock_gettime(ClockId::Monotonic);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

/// Sets how much the middleware itself logs: only errors, or everything it has to say.
pub fn quiet_middleware(quiet: bool) {
    use iceoryx2::prelude::{LogLevel, set_log_level};
    set_log_level(if quiet { LogLevel::Error } else { LogLevel::Debug });
}

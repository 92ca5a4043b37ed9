//! The simulated sensors as devices that real drivers talk to.

mod config;
mod fault;
mod imu_thread;
pub mod livox;
mod source;
pub mod wt901c;

pub use config::DevicesConfig;
pub use fault::{FAULTS_HELP, Fault};
pub use source::DeviceSimulator;

/// Host monotonic time, nanoseconds.
fn now_ns() -> i64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

//! Fits a device's clock to the host's monotonic clock.
//!
//! A device numbers its samples or stamps them with a counter of its own; the host only knows when bytes arrived. Late
//! arrivals are common (latency timers, scheduling), early ones impossible, so the truth is the *lower envelope* of
//! arrivals: [`ClockFit`] keeps the earliest arrival of each stretch of a sliding window, lays the line under all of them
//! that is nearest to them (the edge of their lower convex hull over the window's middle; Moon, Skelly and Towsley 1999),
//! and reads stamps off that line. What stays in the stamps is the smallest delay there is, a constant.
//!
//! ```
//! use evac_clock::{ClockFit, Settings};
//!
//! // 200 samples a second, handed over 0 to 16 ms late.
//! let mut fit = ClockFit::new(Settings::samples(200.0));
//! for n in 0..2000_u64 {
//!     let measured_ns = 1_000_000_000 + n as i64 * 5_000_000;
//!     let arrival_ns = measured_ns + (n as i64 * 7_919_000) % 16_000_000;
//!     if let Some(stamp_ns) = fit.observe(n, arrival_ns).stamp_ns {
//!         assert!((stamp_ns - measured_ns).abs() < 2_000_000);
//!     }
//! }
//! assert!(fit.quality().drift_ppm.abs() < 50.0);
//! ```
//!
//! Memory is bounded, nothing is allocated, and an observation costs O(1) but for a pass over 64 numbers now and then.

mod counter;
mod envelope;
mod fit;
mod settings;
mod steps;

pub use fit::{ClockFit, Observation, Quality};
pub use settings::Settings;
pub use steps::Step;

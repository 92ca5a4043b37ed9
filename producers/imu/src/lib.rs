//! Driver of the WIT Motion WT901C: finds its speed, sets it, times its samples and comes back after whatever happens to it.
//!
//! [`Imu`] ties parts together that know nothing of ports or of each other: the conversation with the module (`session`),
//! samples and their times (`sampler`, on RS485 `poll`), and what the module gives away at rest (`rest`).

mod config;
mod driver;
mod link;
mod note;
mod poll;
mod probe;
mod rest;
mod sampler;
mod session;

pub use config::{Config, Protocol};
pub use driver::Imu;
pub use probe::{Found, probe};

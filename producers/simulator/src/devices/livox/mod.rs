//! A Livox LiDAR on a network address of its own: answers commands, keeps a session and sends packets in real time.
//!
//! ```no_run
//! use evac_simulator::devices::livox::{LivoxConfig, LivoxDevice, Wall};
//!
//! let device = LivoxDevice::start(LivoxConfig::default(), Box::new(Wall))?;
//! device.faults(|faults| faults.lost_share = 0.01);
//! # Ok::<(), std::io::Error>(())
//! ```

mod config;
mod faults;
mod mind;
mod run;
mod scene;
mod sdk1;
mod sdk2;
mod sender;

pub use config::{LivoxConfig, LivoxProtocol, TimeSource};
pub use faults::Faults;
pub use mind::LivoxMind;
pub use run::{LivoxDevice, Sent};
pub use scene::{Scene, WalkFeed, WalkScene, Wall};

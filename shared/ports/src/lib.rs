//! Shared-memory services between evac's processes; the only crate that names iceoryx2.
//!
//! A [`Bus`] is one process's connection to a [`Domain`]. Every data service has an event service of the same name for
//! wake-ups: publish, notify, block, drain. All quality-of-service numbers are in [`services`].

/// The middleware and its version: all processes of a domain must be built with the same one.
pub const MIDDLEWARE: &str = "iceoryx2 0.10.0";

mod bus;
pub mod catalogue;
mod clock;
mod domain;
mod error;
mod frames_port;
mod records_port;
mod requests;
pub mod services;
mod wakeup;
mod wire;

pub use bus::Bus;
pub use clock::{now_ns, quiet_middleware};
pub use domain::{Domain, DomainLock};
pub use error::PortError;
pub use frames_port::{FramePublisher, FrameSample, FrameSubscriber};
pub use records_port::{RecordPublisher, RecordSubscriber};
pub use requests::{RequestReceiver, RequestSender};
pub use wakeup::{Doorbell, Listener, Ringer, Wake, wait_on, wait_on_bells};

//! Bare events without data, by which one stage asks another for something.

use iceoryx2::port::notifier::Notifier;

use crate::PortError;
use crate::bus::{Bus, Ipc, retry};
use crate::services::Qos;
use crate::wakeup::Listener;

/// One that is asked listens twice: for its run loop to wake, and to know what for.
const REQUESTS: Qos = Qos { publishers: 8, subscribers: 8, buffer: 1, borrowed: 1, history: 0, nodes: 24 };

/// Asks.
#[derive(Debug)]
pub struct RequestSender {
    name: &'static str,
    notifier: Notifier<Ipc>,
}

impl RequestSender {
    /// Opens the event service `name` for asking.
    ///
    /// # Errors
    /// [`PortError::Refused`].
    pub fn open(bus: &Bus, name: &'static str) -> Result<Self, PortError> {
        let events = bus.events(name, &REQUESTS)?;
        let notifier = retry(name, "ask", || events.notifier_builder().create())?;
        Ok(Self { name, notifier })
    }

    /// Asks.
    ///
    /// # Errors
    /// [`PortError::Refused`].
    pub fn send(&self) -> Result<(), PortError> {
        self.notifier.notify().map(|_| ()).map_err(|cause| PortError::refused(self.name, "ask", cause))
    }
}

/// Is asked.
#[derive(Debug)]
pub struct RequestReceiver(Listener);

impl RequestReceiver {
    /// Opens the event service `name` for being asked.
    ///
    /// # Errors
    /// [`PortError::Refused`].
    pub fn open(bus: &Bus, name: &'static str) -> Result<Self, PortError> {
        Ok(Self(Listener::open(bus, name, &REQUESTS)?))
    }

    /// What wakes whoever is asked for `name`.
    ///
    /// # Errors
    /// [`PortError::Refused`].
    pub fn listener(bus: &Bus, name: &'static str) -> Result<Listener, PortError> {
        Listener::open(bus, name, &REQUESTS)
    }

    /// Whether somebody has asked since the last call.
    pub fn take(&self) -> bool {
        self.0.drain() > 0
    }
}

//! Sleeping until one of several services has news. Nothing polls or spins.

use std::io::{Read as _, Write as _};
use std::ops::ControlFlow;
use std::os::fd::AsRawFd as _;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::time::Duration;

use iceoryx2::port::listener::{Listener as EventListener, ListenerWaitError};
use iceoryx2::port::notifier::{Notifier, NotifierNotifyError};
use iceoryx2::prelude::*;
use iceoryx2::waitset::WaitSetRunResult;

use crate::PortError;
use crate::bus::{Bus, Ipc, retry};
use crate::services::Qos;

/// Name of the listeners that are woken after all others.
const LAST: &str = "last";

/// What wakes one service's reader.
#[derive(Debug)]
pub struct Listener {
    listener: EventListener<Ipc>,
}

impl Listener {
    pub(crate) fn open(bus: &Bus, service: &'static str, qos: &Qos) -> Result<Self, PortError> {
        let events = bus.events(service, qos)?;
        let name = if bus.wakes_last { LAST } else { "" };
        let name =
            PortName::new(name).map_err(|cause| PortError::refused(service, "name a listener", cause))?;
        let listener = retry(service, "listen", || events.listener_builder().name(&name).create())?;
        Ok(Self { listener })
    }

    /// Sleeps until news comes, `timeout` has passed or a signal arrives, and takes all pending wake-ups. For a reader of one
    /// service that waits often; [`wait_on`] is for several.
    ///
    /// # Errors
    /// [`PortError::Refused`].
    pub fn wait(&self, timeout: Duration) -> Result<(), PortError> {
        match self.listener.timed_wait(|_| {}, timeout) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(cause) => Err(PortError::refused(SEVERAL, "wait", cause)),
        }
    }

    /// Takes all pending wake-ups: they are coalesced, and undrained ones would wake again at once.
    pub(crate) fn drain(&self) -> u64 {
        self.listener.try_wait(|_| {}).unwrap_or(0)
    }
}

/// Wakes one service's readers.
#[derive(Debug)]
pub(crate) struct Waker {
    service: &'static str,
    notifier: Notifier<Ipc>,
}

impl Waker {
    pub(crate) fn open(bus: &Bus, service: &'static str, qos: &Qos) -> Result<Self, PortError> {
        let events = bus.events(service, qos)?;
        let notifier = retry(service, "notify", || events.notifier_builder().create())?;
        Ok(Self { service, notifier })
    }

    /// Wakes all, those that asked for it last.
    pub(crate) fn wake(&self) -> Result<(), PortError> {
        if self.wake_those(false)? {
            self.wake_those(true)?;
        }
        Ok(())
    }

    /// Wakes those that are woken last, or all others; whether there are more.
    fn wake_those(&self, last: bool) -> Result<bool, PortError> {
        let (mut more, mut failure) = (false, None);
        self.notifier.for_each_listener(|one, details| {
            if (details.listener_name.as_str() == LAST) == last {
                failure = failure.take().or(one.notify().err());
            } else {
                more = true;
            }
            CallbackProgression::Continue
        });
        // One that has gone in this moment need not be woken.
        match failure.filter(|failure| *failure != NotifierNotifyError::InvalidListenerKey) {
            Some(cause) => Err(PortError::refused(self.service, "notify", cause)),
            None => Ok(more),
        }
    }
}

/// Wakes a process that waits for something that is no service, from another of its threads.
#[derive(Debug)]
pub struct Doorbell {
    stream: UnixStream,
    descriptor: FileDescriptor,
    ringer: Ringer,
}

/// Rings a [`Doorbell`].
#[derive(Debug, Clone)]
pub struct Ringer(Arc<UnixStream>);

impl Doorbell {
    /// Hangs one up.
    ///
    /// # Errors
    /// [`PortError::Refused`] when the system has no descriptors left.
    pub fn new() -> Result<Self, PortError> {
        let refused = |cause: String| PortError::refused("(doorbell)", "be made", cause);
        let (stream, ringer) = UnixStream::pair().map_err(|cause| refused(cause.to_string()))?;
        for end in [&stream, &ringer] {
            end.set_nonblocking(true).map_err(|cause| refused(cause.to_string()))?;
        }
        let descriptor = FileDescriptor::non_owning_new(stream.as_raw_fd())
            .ok_or_else(|| refused("no descriptor".to_owned()))?;
        Ok(Self { stream, descriptor, ringer: Ringer(Arc::new(ringer)) })
    }

    /// What rings it.
    pub fn ringer(&self) -> Ringer {
        self.ringer.clone()
    }

    fn drain(&self) {
        let mut bytes = [0; 64];
        while matches!((&self.stream).read(&mut bytes), Ok(1..)) {}
    }
}

impl Ringer {
    /// Rings.
    pub fn ring(&self) {
        // A bell that is full of rings rings.
        let _ = (&*self.0).write(&[1]);
    }
}

impl FileDescriptorBased for Doorbell {
    fn file_descriptor(&self) -> &FileDescriptor {
        &self.descriptor
    }
}

impl SynchronousMultiplexing for Doorbell {}

/// Stands for the service's name where it is not one service that refuses.
const SEVERAL: &str = "(all)";

/// Why the waiting process woke.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wake {
    /// News, the time-out, or a signal that asks for nothing (a process that was stopped and goes on).
    Look,
    /// SIGINT or SIGTERM has come; every later wake-up says so too, at once.
    Stop,
}

/// Calls `look` at once and after every wake-up: when a listener hears something, when the time-out that `look` gave last
/// has passed, and on SIGINT or SIGTERM. Returns when `look` breaks, which it has to do on [`Wake::Stop`].
///
/// # Errors
/// [`PortError::Refused`] when the middleware cannot wait, and whatever `look` breaks with.
pub fn wait_on<B>(
    listeners: &[Listener],
    look: impl FnMut(Wake) -> ControlFlow<B, Duration>,
) -> Result<B, PortError> {
    wait_on_bells(listeners, &[], look)
}

/// As [`wait_on`], and also after a ring of a doorbell.
///
/// # Errors
/// As [`wait_on`].
pub fn wait_on_bells<B>(
    listeners: &[Listener],
    bells: &[&Doorbell],
    mut look: impl FnMut(Wake) -> ControlFlow<B, Duration>,
) -> Result<B, PortError> {
    let refused = |cause: String| PortError::refused(SEVERAL, "wait", cause);
    let waitset = WaitSetBuilder::new()
        .signal_handling_mode(SignalHandlingMode::HandleTerminationRequests)
        .create::<Ipc>()
        .map_err(|e| refused(format!("{e:?}")))?;
    let mut guards = Vec::with_capacity(listeners.len() + bells.len());
    for listener in listeners {
        guards.push(waitset.attach_notification(&listener.listener).map_err(|e| refused(format!("{e:?}")))?);
    }
    for bell in bells {
        guards.push(waitset.attach_notification(*bell).map_err(|e| refused(format!("{e:?}")))?);
    }
    let mut wake = Wake::Look;
    loop {
        let timeout = match look(wake) {
            ControlFlow::Continue(timeout) => timeout,
            ControlFlow::Break(value) => return Ok(value),
        };
        let result = waitset
            .wait_and_process_once_with_timeout(
                |attachment| {
                    // Drained before the data is read, so that a notification which comes while reading wakes again.
                    match guards.iter().position(|guard| attachment.has_event_from(guard)) {
                        Some(at) if at < listeners.len() => drop(listeners[at].drain()),
                        Some(at) => bells[at - listeners.len()].drain(),
                        None => {}
                    }
                    CallbackProgression::Continue
                },
                timeout,
            )
            .map_err(|e| refused(format!("{e:?}")))?;
        // An interrupt is any signal, SIGCONT included. SIGINT and SIGTERM are remembered by the middleware, whose next wait
        // ends with them before it begins.
        wake = match result {
            WaitSetRunResult::TerminationRequest => Wake::Stop,
            _ => Wake::Look,
        };
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::Domain;
    use crate::services::{OdometryPose, RecordService as _};

    #[test]
    fn a_reader_that_others_wait_for_is_woken_before_one_that_came_first_and_asked_to_be_last() {
        let domain = Domain::new(&format!("wake-order-{}", std::process::id())).unwrap();
        let _lock = domain.lock().unwrap();
        let bus = Bus::join(&domain, "first").unwrap();
        let saver = Bus::join(&domain, "saver").unwrap().wake_last();
        let (service, qos) = (OdometryPose::NAME, OdometryPose::QOS);
        let last = Listener::open(&saver, service, &qos).unwrap();
        let first = Listener::open(&bus, service, &qos).unwrap();
        let waker = Waker::open(&bus, service, &qos).unwrap();
        assert!(waker.wake_those(false).unwrap(), "there is one more");
        assert_eq!((first.drain(), last.drain()), (1, 0));
        assert!(waker.wake_those(true).unwrap());
        assert_eq!((first.drain(), last.drain()), (0, 1));
        waker.wake().unwrap();
        assert_eq!((first.drain(), last.drain()), (1, 1));
        drop(last);
        assert!(!waker.wake_those(false).unwrap(), "nobody asked to be last");
    }
}

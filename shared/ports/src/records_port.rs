//! Services of fixed-size records.

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use evac_frames::{Layout, layout_hash};

use crate::bus::{Bus, Ipc, layout_attribute, retry, service_name};
use crate::services::RecordService;
use crate::wakeup::{Listener, Waker};
use crate::{PortError, wire::Wire};

fn open<S: RecordService>(bus: &Bus) -> Result<PortFactory<Ipc, Wire<S::Record>, ()>, PortError> {
    let name = service_name(S::NAME)?;
    let layout = format!("{}#{:016x}", S::Record::NAME, layout_hash::<S::Record>());
    let (verifier, _) = layout_attribute(S::NAME, &layout)?;
    retry(S::NAME, "open it", || {
        bus.node
            .service_builder(&name)
            .publish_subscribe::<Wire<S::Record>>()
            .max_publishers(S::QOS.publishers)
            .max_subscribers(S::QOS.subscribers)
            .max_nodes(S::QOS.nodes)
            .subscriber_max_buffer_size(S::QOS.buffer)
            .subscriber_max_borrowed_samples(S::QOS.borrowed)
            .history_size(S::QOS.history)
            .enable_safe_overflow(true)
            .open_or_create_with_attributes(&verifier)
    })
    .map_err(|refusal| bus.explain(S::NAME, &layout, refusal))
}

/// Publishes records of one service.
#[derive(Debug)]
pub struct RecordPublisher<S: RecordService> {
    service: PortFactory<Ipc, Wire<S::Record>, ()>,
    publisher: Publisher<Ipc, Wire<S::Record>, ()>,
    readers: Waker,
}

impl<S: RecordService> RecordPublisher<S> {
    /// Opens the service for publishing.
    ///
    /// # Errors
    /// [`PortError::LayoutMismatch`] and [`PortError::Refused`].
    pub fn open(bus: &Bus) -> Result<Self, PortError> {
        let service = open::<S>(bus)?;
        let publisher =
            retry(S::NAME, "publish", || service.publisher_builder().max_loaned_samples(2).create())?;
        Ok(Self { service, publisher, readers: Waker::open(bus, S::NAME, &S::QOS)? })
    }

    /// Whether somebody reads the service at the moment: a look at shared memory.
    pub fn has_subscriber(&self) -> bool {
        self.service.dynamic_config().number_of_subscribers() > 0
    }

    /// Hands the history to readers that have come since the last sending, and wakes them: who sends nothing for a while would keep them
    /// waiting.
    ///
    /// # Errors
    /// [`PortError::Refused`].
    pub fn greet(&self) -> Result<(), PortError> {
        self.publisher
            .update_connections()
            .map_err(|cause| PortError::refused(S::NAME, "greet new readers", cause))?;
        self.readers.wake()
    }

    /// Publishes one record.
    ///
    /// # Errors
    /// [`PortError::Refused`] when memory is exhausted.
    pub fn publish(&self, record: &S::Record) -> Result<(), PortError> {
        let loan = self
            .publisher
            .loan_uninit()
            .map_err(|cause| PortError::refused(S::NAME, "loan memory", cause))?;
        loan.write_payload(Wire(*record))
            .send()
            .map_err(|cause| PortError::refused(S::NAME, "send", cause))?;
        self.readers.wake()
    }
}

/// Receives records of one service.
#[derive(Debug)]
pub struct RecordSubscriber<S: RecordService> {
    service: PortFactory<Ipc, Wire<S::Record>, ()>,
    subscriber: Subscriber<Ipc, Wire<S::Record>, ()>,
}

impl<S: RecordService> RecordSubscriber<S> {
    /// Opens the service for reading, with the listener that wakes its reader.
    ///
    /// # Errors
    /// [`PortError::LayoutMismatch`] and [`PortError::Refused`].
    pub fn open(bus: &Bus) -> Result<(Self, Listener), PortError> {
        let listener = Listener::open(bus, S::NAME, &S::QOS)?;
        let service = open::<S>(bus)?;
        let subscriber =
            retry(S::NAME, "subscribe", || service.subscriber_builder().buffer_size(S::QOS.buffer).create())?;
        Ok((Self { service, subscriber }, listener))
    }

    /// Whether somebody publishes on the service at the moment.
    pub fn has_publisher(&self) -> bool {
        self.service.dynamic_config().number_of_publishers() > 0
    }

    /// The next record; `None` when all are read.
    ///
    /// # Errors
    /// [`PortError::Refused`].
    pub fn receive(&self) -> Result<Option<S::Record>, PortError> {
        let sample =
            self.subscriber.receive().map_err(|cause| PortError::refused(S::NAME, "receive", cause))?;
        Ok(sample.map(|sample| sample.payload().0))
    }
}

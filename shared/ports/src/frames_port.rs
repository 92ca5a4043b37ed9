//! Services of variable-length frames: a user header and a slice, written once into loaned memory.

use bytemuck::TransparentWrapper;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::bus::{Bus, Ipc, layout_attribute, layout_text, retry, service_name};
use crate::services::{FrameService, SliceLen};
use crate::wakeup::{Listener, Waker};
use crate::{PortError, wire::Wire};

type Item<S> = [Wire<<S as FrameService>::Item>];
type Header<S> = Wire<<S as FrameService>::Header>;

fn open<S: FrameService>(bus: &Bus) -> Result<PortFactory<Ipc, Item<S>, Header<S>>, PortError> {
    let name = service_name(S::NAME)?;
    let layout = layout_text::<S::Header, S::Item>();
    let (verifier, _) = layout_attribute(S::NAME, &layout)?;
    retry(S::NAME, "open it", || {
        bus.node
            .service_builder(&name)
            .publish_subscribe::<Item<S>>()
            .user_header::<Header<S>>()
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

/// Publishes frames of one service.
#[derive(Debug)]
pub struct FramePublisher<S: FrameService> {
    publisher: Publisher<Ipc, Item<S>, Header<S>>,
    readers: Waker,
}

impl<S: FrameService> FramePublisher<S> {
    /// Opens the service for publishing.
    ///
    /// # Errors
    /// [`PortError::LayoutMismatch`] and [`PortError::Refused`].
    pub fn open(bus: &Bus) -> Result<Self, PortError> {
        let service = open::<S>(bus)?;
        let (len, strategy) = match S::LEN {
            SliceLen::Fixed(len) => (len, AllocationStrategy::Static),
            SliceLen::Growing(len) => (len, AllocationStrategy::PowerOfTwo),
        };
        let publisher = retry(S::NAME, "publish", || {
            service
                .publisher_builder()
                .initial_max_slice_len(len)
                .allocation_strategy(strategy)
                .max_loaned_samples(2)
                .create()
        })?;
        Ok(Self { publisher, readers: Waker::open(bus, S::NAME, &S::QOS)? })
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

    /// Publishes one frame: loans memory for `len` elements, writes `fill(0)..fill(len - 1)` straight into it, sets the
    /// header by `header()` at the last moment and hands it over.
    ///
    /// # Errors
    /// [`PortError::Refused`] when the frame is longer than the service allows or memory is exhausted.
    pub fn publish(
        &self,
        len: usize,
        mut fill: impl FnMut(usize) -> S::Item,
        header: impl FnOnce() -> S::Header,
    ) -> Result<(), PortError> {
        let loan = self
            .publisher
            .loan_slice_uninit(len)
            .map_err(|cause| PortError::refused(S::NAME, "loan memory", cause))?;
        let mut sample = loan.write_from_fn(|i| Wire(fill(i)));
        *sample.user_header_mut() = Wire(header());
        sample.send().map_err(|cause| PortError::refused(S::NAME, "send", cause))?;
        self.readers.wake()
    }
}

/// Receives frames of one service.
#[derive(Debug)]
pub struct FrameSubscriber<S: FrameService> {
    service: PortFactory<Ipc, Item<S>, Header<S>>,
    subscriber: Subscriber<Ipc, Item<S>, Header<S>>,
}

impl<S: FrameService> FrameSubscriber<S> {
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

    /// The next frame, borrowed from shared memory until it is dropped; `None` when all are read.
    ///
    /// # Errors
    /// [`PortError::Refused`], for example when more frames are held than the service allows.
    pub fn receive(&self) -> Result<Option<FrameSample<S>>, PortError> {
        let sample =
            self.subscriber.receive().map_err(|cause| PortError::refused(S::NAME, "receive", cause))?;
        Ok(sample.map(FrameSample))
    }
}

/// A frame in shared memory, readable until dropped.
#[derive(Debug)]
pub struct FrameSample<S: FrameService>(Sample<Ipc, Item<S>, Header<S>>);

impl<S: FrameService> FrameSample<S> {
    /// Its header.
    pub fn header(&self) -> &S::Header {
        &self.0.user_header().0
    }

    /// Its elements.
    pub fn items(&self) -> &[S::Item] {
        TransparentWrapper::peel_slice(self.0.payload())
    }
}

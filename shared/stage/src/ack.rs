//! A sink's acknowledgements.

use evac_frames::{Ack, Health};
use evac_ports::services::SinkAck;
use evac_ports::{Bus, PortError, RecordPublisher};

use crate::options::Context;

/// Where a sink says that it is done with a frame.
pub(crate) struct AckPort {
    publisher: RecordPublisher<SinkAck>,
    ack: Ack,
}

impl AckPort {
    pub(crate) fn open(bus: &Bus, context: &Context) -> Result<Self, PortError> {
        let ack = Ack { name: Health::text(&context.name), epoch: context.epoch, ..Ack::default() };
        Ok(Self { publisher: RecordPublisher::open(bus)?, ack })
    }

    pub(crate) fn send(&self, seq: u64, finished: bool) -> Result<(), PortError> {
        self.publisher.publish(&Ack { seq, finished: u32::from(finished), ..self.ack })
    }
}

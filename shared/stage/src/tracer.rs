//! Says when each frame was received, taken up and done, while somebody wants to know.

use evac_frames::{FrameHeader, Health, Trace};
use evac_ports::services::FrameTrace;
use evac_ports::{Bus, PortError, RecordPublisher};

/// Receipts that are remembered: more frames than any join holds.
const RECEIPTS: usize = 64;

/// See the module's text.
#[derive(Debug)]
pub(crate) struct Tracer {
    publisher: RecordPublisher<FrameTrace>,
    name: [u8; 32],
    epoch: u32,
    /// When a frame was handed over, by which it is known again, and when it was received.
    receipts: [(i64, i64); RECEIPTS],
    next: usize,
}

impl Tracer {
    pub(crate) fn open(bus: &Bus, name: &str, epoch: u32) -> Result<Self, PortError> {
        let publisher = RecordPublisher::open(bus)?;
        Ok(Self { publisher, name: Health::text(name), epoch, receipts: [(0, 0); RECEIPTS], next: 0 })
    }

    pub(crate) fn received(&mut self, sent_ns: i64, received_ns: i64) {
        self.next = (self.next + 1) % RECEIPTS;
        if let Some(receipt) = self.receipts.get_mut(self.next) {
            *receipt = (sent_ns, received_ns);
        }
    }

    /// A trace that is lost is nobody's loss but the observer's, and no reason for a stage to fail.
    pub(crate) fn done(&self, header: &FrameHeader, begun_ns: i64, done_ns: i64) {
        if !self.publisher.has_subscriber() {
            return;
        }
        let receipt = self.receipts.iter().find(|(sent_ns, _)| *sent_ns == header.sent_ns);
        let trace = Trace {
            name: self.name,
            seq: header.seq,
            arrival_ns: header.arrival_ns,
            sent_ns: header.sent_ns,
            received_ns: receipt.map_or(0, |(_, received_ns)| *received_ns),
            begun_ns,
            done_ns,
            epoch: self.epoch,
            reserved: 0,
        };
        if let Err(cause) = self.publisher.publish(&trace) {
            tracing::debug!(%cause, "a frame is not traced");
        }
    }
}

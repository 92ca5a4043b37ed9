//! Datagrams to be sent.

use std::net::SocketAddrV4;

/// The socket that a datagram leaves by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Channel {
    /// Commands.
    Command,
    /// Searches.
    Search,
}

/// Datagrams to be sent, in order.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    queue: Vec<(Channel, SocketAddrV4, std::ops::Range<usize>)>,
    bytes: Vec<u8>,
    /// For building a frame.
    pub(super) frame: Vec<u8>,
    /// For building its payload.
    pub(super) payload: Vec<u8>,
}

impl Outbox {
    /// Adds what lies in `frame`.
    pub(super) fn push(&mut self, channel: Channel, to: SocketAddrV4) {
        let start = self.bytes.len();
        self.bytes.extend_from_slice(&self.frame);
        self.queue.push((channel, to, start..self.bytes.len()));
    }

    /// Hands everything over, in order, and forgets it.
    pub(crate) fn drain(&mut self, mut send: impl FnMut(Channel, SocketAddrV4, &[u8])) {
        for (channel, to, range) in self.queue.drain(..) {
            send(channel, to, self.bytes.get(range).unwrap_or_default());
        }
        self.bytes.clear();
    }
}

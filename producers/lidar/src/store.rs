//! Where packets lie from the moment the system hands them over until their points are written into a scan.

/// Longest packet, bytes: what fits into an Ethernet frame.
pub(crate) const PACKET_BYTES: usize = 1500;
/// Packets that are kept: 150 ms of an Avia with three echoes of each shot, and a batch.
pub(crate) const SLOTS: usize = 1536;

/// Number of a place in the store.
pub(crate) type Slot = u16;

/// Places for packets; all memory is allocated at the start.
#[derive(Debug)]
pub(crate) struct Store {
    bytes: Box<[[u8; PACKET_BYTES]]>,
    lengths: Box<[u16]>,
    free: Vec<Slot>,
}

impl Store {
    pub(crate) fn new() -> Self {
        Self {
            bytes: vec![[0; PACKET_BYTES]; SLOTS].into_boxed_slice(),
            lengths: vec![0; SLOTS].into_boxed_slice(),
            free: (0..SLOTS as Slot).rev().collect(),
        }
    }

    /// A place that nobody uses, until it is given back.
    pub(crate) fn take(&mut self) -> Option<Slot> {
        self.free.pop()
    }

    /// Gives a place back.
    pub(crate) fn give_back(&mut self, slot: Slot) {
        self.free.push(slot);
    }

    /// Places that nobody uses.
    #[cfg(test)]
    pub(crate) fn free(&self) -> usize {
        self.free.len()
    }

    /// The packet in a place.
    pub(crate) fn packet(&self, slot: Slot) -> &[u8] {
        let slot = usize::from(slot);
        let length = self.lengths.get(slot).map_or(0, |length| usize::from(*length));
        self.bytes.get(slot).and_then(|bytes| bytes.get(..length)).unwrap_or_default()
    }

    /// The whole place, to be written to.
    pub(crate) fn place(&mut self, slot: Slot) -> Option<&mut [u8; PACKET_BYTES]> {
        self.bytes.get_mut(usize::from(slot))
    }

    /// Says how much of a place was written.
    pub(crate) fn set_length(&mut self, slot: Slot, length: usize) {
        if let Some(to) = self.lengths.get_mut(usize::from(slot)) {
            *to = length.min(PACKET_BYTES) as u16;
        }
    }
}

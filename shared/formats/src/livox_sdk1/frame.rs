//! The control frame: a header of 11 bytes, a payload and a CRC-32 over all.

/// Bytes before the payload.
const HEADER_BYTES: usize = 11;
/// Bytes that are not payload.
const OVERHEAD: usize = HEADER_BYTES + 4;
/// Longest frame, bytes.
pub const MAX_FRAME_BYTES: usize = 1400;
/// Bytes up to and with the header's own checksum.
const PREAMBLE_BYTES: usize = 9;
const START: u8 = 0xaa;
const VERSION: u8 = 1;

/// Who wants what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum FrameKind {
    /// Wants an answer.
    Command = 0,
    /// Answers the command with the same sequence number. (The vendor's software also sends its handshakes so.)
    Ack = 1,
    /// Wants no answer.
    Message = 2,
}

/// A control frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Command, answer or message.
    pub kind: FrameKind,
    /// Number that an answer repeats.
    pub sequence: u16,
    /// 0 general, 1 LiDAR, 2 hub.
    pub set: u8,
    /// Command within the set.
    pub id: u8,
    /// What follows the header.
    pub payload: &'a [u8],
}

impl Frame<'_> {
    /// Replaces `out` by the frame's bytes. A payload that makes it longer than [`MAX_FRAME_BYTES`] is cut off.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let payload = self.payload.get(..MAX_FRAME_BYTES - OVERHEAD).unwrap_or(self.payload);
        out.clear();
        out.extend_from_slice(&[START, VERSION]);
        out.extend_from_slice(&((OVERHEAD + payload.len()) as u16).to_le_bytes());
        out.push(self.kind as u8);
        out.extend_from_slice(&self.sequence.to_le_bytes());
        out.extend_from_slice(&crc16(out).to_le_bytes());
        out.extend_from_slice(&[self.set, self.id]);
        out.extend_from_slice(payload);
        out.extend_from_slice(&crc32(out).to_le_bytes());
    }
}

/// The whole frames in some bytes: junk is skipped byte by byte and a damaged frame by its preamble, as the vendor's parser does.
#[derive(Debug, Clone)]
pub struct Frames<'a> {
    left: &'a [u8],
    skipped: usize,
}

impl<'a> Frames<'a> {
    /// The frames of a datagram.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { left: bytes, skipped: 0 }
    }

    /// Bytes so far that belong to no whole frame.
    pub fn skipped(&self) -> usize {
        self.skipped
    }

    fn skip(&mut self, bytes: usize) {
        let bytes = bytes.min(self.left.len());
        self.left = self.left.get(bytes..).unwrap_or_default();
        self.skipped += bytes;
    }
}

impl<'a> Iterator for Frames<'a> {
    type Item = Frame<'a>;

    fn next(&mut self) -> Option<Frame<'a>> {
        while let Some(preamble) = self.left.first_chunk::<PREAMBLE_BYTES>() {
            // A header with its own CRC behind it has the CRC 0.
            let [start, _, l0, l1, kind, s0, s1, ..] = *preamble;
            let length = usize::from(u16::from_le_bytes([l0, l1]));
            if start != START || crc16(preamble) != 0 || !(OVERHEAD..=MAX_FRAME_BYTES).contains(&length) {
                self.skip(1);
                continue;
            }
            let kind = match kind {
                0 => Some(FrameKind::Command),
                1 => Some(FrameKind::Ack),
                2 => Some(FrameKind::Message),
                _ => None,
            };
            let whole = self.left.split_at_checked(length);
            let parts = whole.and_then(|(frame, rest)| {
                let (covered, stored) = frame.split_last_chunk::<4>()?;
                (crc32(covered) == u32::from_le_bytes(*stored)).then_some((covered, rest))
            });
            let (Some(kind), Some((covered, rest))) = (kind, parts) else {
                self.skip(PREAMBLE_BYTES);
                continue;
            };
            let (Some(payload), [.., set, id]) =
                (covered.get(HEADER_BYTES..), *covered.first_chunk::<HEADER_BYTES>()?)
            else {
                return None;
            };
            self.left = rest;
            return Some(Frame { kind, sequence: u16::from_le_bytes([s0, s1]), set, id, payload });
        }
        self.skip(usize::MAX);
        None
    }
}

/// CRC-16 of the MCRF4XX family: polynomial 0x1021 reflected, register start 0x4C49, no final xor.
pub(super) fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0x4c49, |crc, byte| {
        (0..8)
            .fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 0 { crc >> 1 } else { (crc >> 1) ^ 0x8408 })
    })
}

/// zlib's CRC-32 with the seed 0x564F580A.
pub(super) fn crc32(bytes: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new_with_initial(0x564f_580a);
    hasher.update(bytes);
    hasher.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_the_vendor_s() {
        for (bytes, expected16, expected32) in [
            (&b"\0"[..], 0xdf89, 0x3281_49cb),
            (b"123456789", 0xab4e, 0xb08d_b5b1),
            (b"\xaa\x01\x19\x00\x01\x02\x00", 0x31b0, 0x9b87_378f),
            (b"\0\x01\x02\x03\x04\x05\x06\x07\x08\x09\x0a\x0b\x0c\x0d\x0e", 0x5e79, 0x9a8a_7491),
        ] {
            assert_eq!((crc16(bytes), crc32(bytes)), (expected16, expected32), "{bytes:?}");
        }
    }
}

//! The control frame: a header of 24 bytes and data.

/// Bytes before the data.
const HEADER_BYTES: usize = 24;
/// Longest frame, bytes.
pub const MAX_FRAME_BYTES: usize = 1400;
const START: u8 = 0xaa;
const VERSION: u8 = 0;

/// Request or answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum FrameKind {
    /// Wants an answer, except for pushed information.
    Request = 0,
    /// Answers the request with the same sequence number.
    Ack = 1,
}

/// Who sends it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Sender {
    /// The computer.
    Host = 0,
    /// The device.
    Lidar = 1,
}

/// Why bytes are no control frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// Fewer bytes than the header, or than the header says.
    #[error("{have} bytes are fewer than the {needed} of the frame")]
    TooShort {
        /// Bytes that are there.
        have: usize,
        /// Bytes that the frame has.
        needed: usize,
    },
    /// No frame begins so.
    #[error("the frame begins with {0:#04x} and not with 0xaa")]
    Start(u8),
    /// Another version of the protocol.
    #[error("version {0} is not 0")]
    Version(u8),
    /// A length that no frame has.
    #[error("a length of {0} bytes is outside 24 to 1400")]
    Length(usize),
    /// Damaged.
    #[error("the header's CRC-16 or the data's CRC-32 is wrong")]
    Checksum,
    /// A kind of frame or sender that the protocol does not define.
    #[error("command type {kind} from sender {sender} is not defined")]
    Kind {
        /// Command type.
        kind: u8,
        /// Sender type.
        sender: u8,
    },
}

/// A control frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Number that an answer repeats.
    pub sequence: u32,
    /// See [`super::command`].
    pub command: u16,
    /// Request or answer.
    pub kind: FrameKind,
    /// Who sends it.
    pub sender: Sender,
    /// What follows the header.
    pub data: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Reads the frame at the start of a datagram; what follows it is ignored, as the vendor's parser does.
    ///
    /// # Errors
    /// [`FrameError`] for anything that no device or host sends.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, FrameError> {
        let too_short = |needed| FrameError::TooShort { have: bytes.len(), needed };
        let header = bytes.first_chunk::<HEADER_BYTES>().ok_or(too_short(HEADER_BYTES))?;
        let [start, version, l0, l1, s0, s1, s2, s3, c0, c1, kind, sender, rest @ ..] = *header;
        if start != START {
            return Err(FrameError::Start(start));
        }
        if version != VERSION {
            return Err(FrameError::Version(version));
        }
        let length = usize::from(u16::from_le_bytes([l0, l1]));
        if !(HEADER_BYTES..=MAX_FRAME_BYTES).contains(&length) {
            return Err(FrameError::Length(length));
        }
        let data = bytes.get(HEADER_BYTES..length).ok_or(too_short(length))?;
        let [_, _, _, _, _, _, h0, h1, d0, d1, d2, d3] = rest;
        let (covered, _) = header.split_at(18);
        if crc16(covered) != u16::from_le_bytes([h0, h1])
            || crc32(data) != u32::from_le_bytes([d0, d1, d2, d3])
        {
            return Err(FrameError::Checksum);
        }
        let known = match (kind, sender) {
            (0, 0) => Some((FrameKind::Request, Sender::Host)),
            (0, 1) => Some((FrameKind::Request, Sender::Lidar)),
            (1, 0) => Some((FrameKind::Ack, Sender::Host)),
            (1, 1) => Some((FrameKind::Ack, Sender::Lidar)),
            _ => None,
        };
        let (kind, sender) = known.ok_or(FrameError::Kind { kind, sender })?;
        let sequence = u32::from_le_bytes([s0, s1, s2, s3]);
        Ok(Self { sequence, command: u16::from_le_bytes([c0, c1]), kind, sender, data })
    }

    /// Replaces `out` by the frame's bytes. Data beyond [`MAX_FRAME_BYTES`] is cut off.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let data = self.data.get(..MAX_FRAME_BYTES - HEADER_BYTES).unwrap_or(self.data);
        out.clear();
        out.extend_from_slice(&[START, VERSION]);
        out.extend_from_slice(&((HEADER_BYTES + data.len()) as u16).to_le_bytes());
        out.extend_from_slice(&self.sequence.to_le_bytes());
        out.extend_from_slice(&self.command.to_le_bytes());
        out.extend_from_slice(&[self.kind as u8, self.sender as u8, 0, 0, 0, 0, 0, 0]);
        out.extend_from_slice(&crc16(out).to_le_bytes());
        out.extend_from_slice(&crc32(data).to_le_bytes());
        out.extend_from_slice(data);
    }
}

/// CRC-16/IBM-3740 (CCITT-FALSE): polynomial 0x1021, start 0xFFFF, not reflected.
pub(super) fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |crc, byte| {
        (0..8).fold(crc ^ (u16::from(*byte) << 8), |crc, _| {
            if crc & 0x8000 == 0 { crc << 1 } else { (crc << 1) ^ 0x1021 }
        })
    })
}

/// CRC-32/ISO-HDLC (zlib's); 0 where there is no data, as the protocol wants it.
pub(super) fn crc32(bytes: &[u8]) -> u32 {
    crc32fast::hash(bytes)
}

//! Primitives of the ROS 1 serialisation.

/// Why bytes are not the message they should be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MessageError {
    /// The message is shorter than its fields.
    #[error("the message ends inside its field at byte {0}")]
    Truncated(usize),
    /// A point cloud without a coordinate.
    #[error("the cloud has no field \"{0}\" of type FLOAT32 or FLOAT64")]
    MissingField(&'static str),
    /// Fields, steps and data of a point cloud that do not fit together.
    #[error(
        "the cloud of {width} x {height} points with steps {point_step} and {row_step} does not fit into {bytes} bytes"
    )]
    Layout {
        /// Points in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes from point to point.
        point_step: u32,
        /// Bytes from row to row.
        row_step: u32,
        /// Length of the data.
        bytes: usize,
    },
}

/// `std_msgs/Header`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header<'a> {
    /// Sequence number given by the publisher.
    pub seq: u32,
    /// Nanoseconds since 1970, or since power-on for a Livox device without synchronisation.
    pub stamp_ns: i64,
    /// Name of the coordinate frame, usually UTF-8.
    pub frame_id: &'a [u8],
}

/// Reads fields one after the other.
#[derive(Debug)]
pub(super) struct Wire<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Wire<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    pub(super) fn take(&mut self, length: usize) -> Result<&'a [u8], MessageError> {
        let end = self.at.checked_add(length);
        let taken =
            end.and_then(|end| self.bytes.get(self.at..end)).ok_or(MessageError::Truncated(self.at))?;
        self.at += length;
        Ok(taken)
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], MessageError> {
        let at = self.at;
        self.take(N)?.first_chunk().copied().ok_or(MessageError::Truncated(at))
    }

    pub(super) fn u8(&mut self) -> Result<u8, MessageError> {
        self.array::<1>().map(|[byte]| byte)
    }

    pub(super) fn u32(&mut self) -> Result<u32, MessageError> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Result<u64, MessageError> {
        self.array().map(u64::from_le_bytes)
    }

    pub(super) fn f64(&mut self) -> Result<f64, MessageError> {
        self.array().map(f64::from_le_bytes)
    }

    pub(super) fn vector(&mut self) -> Result<[f64; 3], MessageError> {
        Ok([self.f64()?, self.f64()?, self.f64()?])
    }

    /// A string or an array of bytes: its length, then itself.
    pub(super) fn counted_bytes(&mut self) -> Result<&'a [u8], MessageError> {
        let length = self.u32()? as usize;
        self.take(length)
    }

    pub(super) fn header(&mut self) -> Result<Header<'a>, MessageError> {
        let (seq, seconds, nanoseconds) = (self.u32()?, self.u32()?, self.u32()?);
        let stamp_ns = i64::from(seconds) * 1_000_000_000 + i64::from(nanoseconds);
        Ok(Header { seq, stamp_ns, frame_id: self.counted_bytes()? })
    }
}

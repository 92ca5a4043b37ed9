//! Primitives of the ROS serialisations.

/// How a message is serialised.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// ROS 1: little-endian, packed.
    Ros1,
    /// ROS 2: CDR (XCDR1) behind four bytes of encapsulation, which say the byte order; numbers are aligned to their size.
    Cdr,
}

/// Why bytes are not the message they should be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MessageError {
    /// The message is shorter than its fields.
    #[error("the message ends inside its field at byte {0}")]
    Truncated(usize),
    /// Bytes before a ROS 2 message that do not announce plain CDR.
    #[error("the encapsulation is {0:02x} {1:02x}, not that of plain CDR (00 00 or 00 01)")]
    Encapsulation(u8, u8),
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
    /// Sequence number given by the publisher; 0 in ROS 2.
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
    encoding: Encoding,
    /// Bytes before the first field, where alignment counts from.
    origin: usize,
    pub(super) big_endian: bool,
}

impl<'a> Wire<'a> {
    pub(super) fn new(bytes: &'a [u8], encoding: Encoding) -> Result<Self, MessageError> {
        let mut wire = Self { bytes, at: 0, encoding, origin: 0, big_endian: false };
        if encoding == Encoding::Cdr {
            let [high, low, ..] = wire.array::<4>()?;
            if high != 0 || low > 1 {
                return Err(MessageError::Encapsulation(high, low));
            }
            (wire.origin, wire.big_endian) = (4, low == 0);
        }
        Ok(wire)
    }

    /// The next `length` bytes as they are.
    pub(super) fn take(&mut self, length: usize) -> Result<&'a [u8], MessageError> {
        let end = self.at.checked_add(length);
        let taken =
            end.and_then(|end| self.bytes.get(self.at..end)).ok_or(MessageError::Truncated(self.at))?;
        self.at += length;
        Ok(taken)
    }

    /// Bytes from one of several elements of `size` bytes to the next, which are aligned to `alignment`.
    pub(super) fn stride(&self, size: usize, alignment: usize) -> usize {
        match self.encoding {
            Encoding::Ros1 => size,
            Encoding::Cdr => size.next_multiple_of(alignment),
        }
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], MessageError> {
        let at = self.at;
        self.take(N)?.first_chunk().copied().ok_or(MessageError::Truncated(at))
    }

    /// A number's bytes, aligned to their count, in little-endian order.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], MessageError> {
        if self.encoding == Encoding::Cdr {
            self.at = self.origin + (self.at - self.origin).next_multiple_of(N);
        }
        let mut bytes = self.array()?;
        if self.big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    pub(super) fn u8(&mut self) -> Result<u8, MessageError> {
        self.array::<1>().map(|[byte]| byte)
    }

    pub(super) fn u32(&mut self) -> Result<u32, MessageError> {
        self.number().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Result<u64, MessageError> {
        self.number().map(u64::from_le_bytes)
    }

    pub(super) fn f64s<const N: usize>(&mut self) -> Result<[f64; N], MessageError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = f64::from_bits(self.u64()?);
        }
        Ok(values)
    }

    /// An array of bytes: its length, then itself.
    pub(super) fn counted_bytes(&mut self) -> Result<&'a [u8], MessageError> {
        let length = self.u32()? as usize;
        self.take(length)
    }

    /// A string, without the zero that ends it in CDR.
    pub(super) fn string(&mut self) -> Result<&'a [u8], MessageError> {
        let text = self.counted_bytes()?;
        match self.encoding {
            Encoding::Ros1 => Ok(text),
            Encoding::Cdr => Ok(text.strip_suffix(&[0]).unwrap_or(text)),
        }
    }

    pub(super) fn header(&mut self) -> Result<Header<'a>, MessageError> {
        let (seq, seconds) = match self.encoding {
            Encoding::Ros1 => (self.u32()?, i64::from(self.u32()?)),
            // Signed in ROS 2.
            Encoding::Cdr => (0, i64::from(self.u32()?.cast_signed())),
        };
        let stamp_ns = seconds * 1_000_000_000 + i64::from(self.u32()?);
        Ok(Header { seq, stamp_ns, frame_id: self.string()? })
    }
}

//! The 36-byte header of a data datagram.

/// Bytes before the first record.
pub(super) const HEADER_BYTES: usize = 36;
/// The checksum covers everything from the time stamp on.
pub(super) const CHECKED_FROM: usize = 28;
const VERSION: u8 = 0;

/// Why bytes are not a data datagram. The numbers are what the datagram holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum DatagramError {
    /// Fewer bytes than a header and one record.
    #[error("{0} bytes are too few for a data datagram")]
    TooShort(usize),
    /// Not a data datagram of this protocol (a control frame begins with 0xAA).
    #[error("version byte is {0}, not 0")]
    Version(u8),
    /// A datagram that was cut or joined.
    #[error("the header says {said} bytes and the datagram has {have}")]
    Length {
        /// Length field.
        said: usize,
        /// Bytes that came.
        have: usize,
    },
    /// A kind of record that the protocol does not define.
    #[error("data type {0:#04x} is not one of 0 to 3 and 0x11")]
    DataType(u8),
    /// The records do not fill the datagram.
    #[error("{records} records of {record} bytes do not fill {have} bytes")]
    Records {
        /// Records that the header says.
        records: usize,
        /// Size of one record.
        record: usize,
        /// Bytes after the header.
        have: usize,
    },
    /// A clock source that the protocol does not define.
    #[error("time type {0} is not 0, 1 or 2")]
    TimeType(u8),
    /// A time stamp of more nanoseconds than 292 years have.
    #[error("the time stamp is beyond 2^63 ns")]
    Stamp,
    /// Damaged.
    #[error("the CRC-32 of time stamp and records is wrong")]
    Checksum,
}

/// Kind of the records of a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum DataType {
    /// Angular velocity in rad/s and specific force in g.
    Imu = 0,
    /// i32 x, y, z in mm, reflectivity and tag.
    Cartesian32 = 1,
    /// i16 x, y, z in **cm**, reflectivity and tag.
    Cartesian16 = 2,
    /// Depth in mm, zenith and azimuth in 0.01 degrees, reflectivity and tag.
    Spherical = 3,
    /// Two `Cartesian32` echoes of each shot (only in the newest devices).
    DualCartesian = 0x11,
}

impl DataType {
    /// The type of a header's data type byte.
    pub fn from_wire(value: u8) -> Option<Self> {
        Some(match value {
            0 => Self::Imu,
            1 => Self::Cartesian32,
            2 => Self::Cartesian16,
            3 => Self::Spherical,
            0x11 => Self::DualCartesian,
            _ => return None,
        })
    }

    /// Bytes of one record (one laser shot with all its echoes, or one IMU sample).
    #[inline]
    pub fn record_bytes(self) -> usize {
        match self {
            Self::Imu => 24,
            Self::Cartesian32 => 14,
            Self::Cartesian16 => 8,
            Self::Spherical => 10,
            Self::DualCartesian => 28,
        }
    }

    /// Points in one record; an IMU record has none.
    #[inline]
    pub fn echoes(self) -> usize {
        match self {
            Self::Imu => 0,
            Self::DualCartesian => 2,
            _ => 1,
        }
    }
}

/// Source of a device's clock; the stamp is always a number of nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum TimeType {
    /// Nanoseconds since power-on.
    PowerOn = 0,
    /// Nanoseconds of a PTP or gPTP master.
    Ptp = 1,
    /// Nanoseconds of GPS.
    Gps = 2,
}

impl TimeType {
    /// The type of a header's time type byte.
    pub fn from_wire(value: u8) -> Option<Self> {
        Some(match value {
            0 => Self::PowerOn,
            1 => Self::Ptp,
            2 => Self::Gps,
            _ => return None,
        })
    }
}

/// The fields before the records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DataHeader {
    /// Time of the last shot less time of the first, nanoseconds (0.1 us on the wire).
    pub interval_ns: i64,
    /// Shots, or IMU samples.
    pub records: u16,
    /// Number of the datagram, one more each, back to 0 at a frame's start.
    pub number: u16,
    /// Number of the frame; of no meaning in a non-repetitive scan.
    pub frame: u8,
    /// Kind of the records.
    pub data_type: DataType,
    /// Source of the clock.
    pub time_type: TimeType,
    /// Time of the first record in nanoseconds of the device's clock.
    pub stamp_ns: i64,
}

impl DataHeader {
    /// Reads the header at the start of a datagram and compares its length with the datagram's.
    ///
    /// # Errors
    /// [`DatagramError`] for anything that no device sends; the checksum is not looked at.
    pub fn parse(bytes: &[u8]) -> Result<Self, DatagramError> {
        let header = bytes.first_chunk::<HEADER_BYTES>().ok_or(DatagramError::TooShort(bytes.len()))?;
        let [version, l0, l1, i0, i1, n0, n1, u0, u1, frame, data_type, time_type, rest @ ..] = *header;
        let [.., t0, t1, t2, t3, t4, t5, t6, t7] = rest;
        if version != VERSION {
            return Err(DatagramError::Version(version));
        }
        let said = usize::from(u16::from_le_bytes([l0, l1]));
        if said != bytes.len() {
            return Err(DatagramError::Length { said, have: bytes.len() });
        }
        let stamp = u64::from_le_bytes([t0, t1, t2, t3, t4, t5, t6, t7]);
        let interval = u16::from_le_bytes([i0, i1]);
        Ok(Self {
            interval_ns: i64::from(interval) * 100,
            records: u16::from_le_bytes([n0, n1]),
            number: u16::from_le_bytes([u0, u1]),
            frame,
            data_type: DataType::from_wire(data_type).ok_or(DatagramError::DataType(data_type))?,
            time_type: TimeType::from_wire(time_type).ok_or(DatagramError::TimeType(time_type))?,
            stamp_ns: i64::try_from(stamp).map_err(|_| DatagramError::Stamp)?,
        })
    }
}

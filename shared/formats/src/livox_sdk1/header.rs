//! The 18-byte header of a data datagram.

/// Bytes before the first record.
pub(super) const HEADER_BYTES: usize = 18;

/// The only protocol version that devices send.
const VERSION: u8 = 5;

/// Why bytes are not a data datagram. The numbers are what the datagram holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum DatagramError {
    /// Fewer bytes than a header and one record.
    #[error("{0} bytes are too few for a data datagram")]
    TooShort(usize),
    /// Not a data datagram of this protocol (a control frame begins with 0xAA).
    #[error("version byte is {0}, not 5")]
    Version(u8),
    /// A kind of record that the protocol does not define.
    #[error("data type {0} is not one of 0 to 8")]
    DataType(u8),
    /// The records do not fill the datagram.
    #[error("{extra} bytes are left over after records of {record} bytes")]
    Remainder {
        /// Size of one record.
        record: usize,
        /// Bytes after the last whole record.
        extra: usize,
    },
    /// A clock source that the protocol does not define.
    #[error("timestamp type {0} is not 0, 1, 3 or 4")]
    TimestampType(u8),
    /// A date that does not exist, for example month 13.
    #[error("the UTC time stamp holds no valid date")]
    Date,
    /// A time stamp of more nanoseconds than 292 years have.
    #[error("the time stamp is beyond 2^63 ns")]
    Stamp,
}

/// Kind of the records of a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum DataType {
    /// i32 x, y, z in mm and reflectivity (Mid-40, Mid-100).
    Cartesian = 0,
    /// Depth in mm, zenith and azimuth in 0.01 degrees, reflectivity (Mid-40, Mid-100).
    Spherical = 1,
    /// Cartesian with a tag.
    ExtendedCartesian = 2,
    /// Spherical with a tag.
    ExtendedSpherical = 3,
    /// Two extended Cartesian echoes of each shot.
    DualCartesian = 4,
    /// Two echoes along each direction.
    DualSpherical = 5,
    /// Angular velocity in rad/s and specific force in g.
    Imu = 6,
    /// Three extended Cartesian echoes of each shot.
    TripleCartesian = 7,
    /// Three echoes along each direction.
    TripleSpherical = 8,
}

impl DataType {
    /// The type of a header's data type byte.
    pub fn from_wire(value: u8) -> Option<Self> {
        Some(match value {
            0 => Self::Cartesian,
            1 => Self::Spherical,
            2 => Self::ExtendedCartesian,
            3 => Self::ExtendedSpherical,
            4 => Self::DualCartesian,
            5 => Self::DualSpherical,
            6 => Self::Imu,
            7 => Self::TripleCartesian,
            8 => Self::TripleSpherical,
            _ => return None,
        })
    }

    /// Bytes of one record (one laser shot with all its echoes, or one IMU sample).
    #[inline]
    pub fn record_bytes(self) -> usize {
        match self {
            Self::Cartesian => 13,
            Self::Spherical => 9,
            Self::ExtendedCartesian => 14,
            Self::ExtendedSpherical => 10,
            Self::DualCartesian => 28,
            Self::DualSpherical => 16,
            Self::Imu => 24,
            Self::TripleCartesian => 42,
            Self::TripleSpherical => 22,
        }
    }

    /// Points in one record; an IMU record has none.
    #[inline]
    pub fn echoes(self) -> usize {
        match self {
            Self::Imu => 0,
            Self::DualCartesian | Self::DualSpherical => 2,
            Self::TripleCartesian | Self::TripleSpherical => 3,
            _ => 1,
        }
    }
}

/// Source of a device's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum TimestampType {
    /// Nanoseconds since power-on.
    PowerOn = 0,
    /// Nanoseconds of a PTP master.
    Ptp = 1,
    /// UTC with a resolution of 1 us.
    Utc = 3,
    /// Nanoseconds since the last pulse; restarts at every pulse.
    Pps = 4,
}

impl TimestampType {
    /// The type of a header's timestamp type byte.
    pub fn from_wire(value: u8) -> Option<Self> {
        Some(match value {
            0 => Self::PowerOn,
            1 => Self::Ptp,
            3 => Self::Utc,
            4 => Self::Pps,
            _ => return None,
        })
    }

    /// Nanoseconds of a header's eight time stamp bytes; `None` where they hold no date or exceed `i64`.
    pub fn nanoseconds(self, bytes: [u8; 8]) -> Option<i64> {
        let [year, month, day, hour, microseconds @ ..] = bytes;
        if self != Self::Utc {
            return i64::try_from(u64::from_le_bytes(bytes)).ok();
        }
        let microseconds = u32::from_le_bytes(microseconds);
        let seconds = crate::utc::seconds(2000 + i64::from(year), month, day, hour, 0, 0)?;
        (microseconds < 3_600_000_000).then_some(seconds * 1_000_000_000 + i64::from(microseconds) * 1000)
    }
}

/// The fields before the records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DataHeader {
    /// Slot of a hub, or 1.
    pub slot: u8,
    /// Number of the LiDAR at its hub, or 1.
    pub lidar_id: u8,
    /// Status word: temperature, voltage, motor, dirt, synchronisation.
    pub status: u32,
    /// Source of the clock.
    pub timestamp_type: TimestampType,
    /// Kind of the records.
    pub data_type: DataType,
    /// Time of the first record in nanoseconds of the device's clock.
    pub stamp_ns: i64,
}

impl DataHeader {
    /// Reads the header at the start of a datagram.
    ///
    /// # Errors
    /// [`DatagramError`] for anything that no device sends.
    pub fn parse(bytes: &[u8]) -> Result<Self, DatagramError> {
        let too_short = DatagramError::TooShort(bytes.len());
        let (head, stamp) = bytes.split_first_chunk::<10>().ok_or(too_short)?;
        let stamp = *stamp.first_chunk::<8>().ok_or(too_short)?;
        let [version, slot, lidar_id, _, s0, s1, s2, s3, timestamp_type, data_type] = *head;
        if version != VERSION {
            return Err(DatagramError::Version(version));
        }
        let data_type = DataType::from_wire(data_type).ok_or(DatagramError::DataType(data_type))?;
        let timestamp_type =
            TimestampType::from_wire(timestamp_type).ok_or(DatagramError::TimestampType(timestamp_type))?;
        let stamp_ns = timestamp_type.nanoseconds(stamp).ok_or(match timestamp_type {
            TimestampType::Utc => DatagramError::Date,
            _ => DatagramError::Stamp,
        })?;
        let status = u32::from_le_bytes([s0, s1, s2, s3]);
        Ok(Self { slot, lidar_id, status, timestamp_type, data_type, stamp_ns })
    }
}

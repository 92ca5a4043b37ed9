//! The records of a data datagram.

use super::frame::crc32;
use super::header::{CHECKED_FROM, DataHeader, DataType, DatagramError, HEADER_BYTES};
use crate::livox_sdk1::{ImuRecord, LivoxPoint, extended_cartesian, imu, spherical};

/// One data datagram: its header, and its records, which are decoded when they are asked for.
#[derive(Debug, Clone, Copy)]
pub struct Datagram<'a> {
    /// Clock, kind of records and numbers.
    pub header: DataHeader,
    records: &'a [u8],
}

impl<'a> Datagram<'a> {
    /// Checks a UDP payload with its checksum.
    ///
    /// # Errors
    /// [`DatagramError`]: it is no data datagram of this protocol, or damaged.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, DatagramError> {
        let datagram = Self::parse_unchecked(bytes)?;
        let stored = bytes.get(24..).and_then(<[u8]>::first_chunk).copied().map(u32::from_le_bytes);
        match bytes.get(CHECKED_FROM..) {
            Some(checked) if stored == Some(crc32(checked)) => Ok(datagram),
            _ => Err(DatagramError::Checksum),
        }
    }

    /// Checks everything but the checksum, for bytes that [`Datagram::parse`] has taken before.
    ///
    /// # Errors
    /// [`DatagramError`]: it is no data datagram of this protocol.
    pub fn parse_unchecked(bytes: &'a [u8]) -> Result<Self, DatagramError> {
        let header = DataHeader::parse(bytes)?;
        let data = bytes.get(HEADER_BYTES..).unwrap_or_default();
        let (records, record) = (usize::from(header.records), header.data_type.record_bytes());
        if data.len() < record {
            return Err(DatagramError::TooShort(bytes.len()));
        }
        if records * record != data.len() {
            return Err(DatagramError::Records { records, record, have: data.len() });
        }
        Ok(Self { header, records: data })
    }

    /// Records: laser shots, or IMU samples.
    pub fn shots(&self) -> usize {
        usize::from(self.header.records)
    }

    /// Points of all echoes; 0 for an IMU datagram.
    pub fn points(&self) -> usize {
        self.shots() * self.header.data_type.echoes()
    }

    /// Time of shot `index` after the first, nanoseconds: evenly spread over the header's interval, as the vendor's
    /// document says. (Its ROS driver divides by the number of shots instead of one less: at most 5 us earlier.)
    pub fn shot_offset_ns(&self, index: usize) -> i64 {
        match i64::from(self.header.records) - 1 {
            steps if steps > 0 => self.header.interval_ns * index as i64 / steps,
            _ => 0,
        }
    }

    /// Point `index`; the echoes of one shot follow each other, so its shot is `index / echoes`.
    #[inline]
    pub fn point(&self, index: usize) -> Option<LivoxPoint> {
        // An echo of two is a record of half the size.
        let size = self.header.data_type.record_bytes().checked_div(self.header.data_type.echoes())?;
        let start = index.checked_mul(size)?;
        let record = self.records.get(start..start.checked_add(size)?)?;
        match self.header.data_type {
            DataType::Cartesian32 | DataType::DualCartesian => extended_cartesian(record),
            DataType::Cartesian16 => cartesian16(record),
            DataType::Spherical => spherical(record, record.get(4..)?, true),
            DataType::Imu => None,
        }
    }

    /// IMU sample `index`; `None` for a datagram of points.
    pub fn imu(&self, index: usize) -> Option<ImuRecord> {
        if self.header.data_type != DataType::Imu {
            return None;
        }
        let start = index.checked_mul(24)?;
        imu(self.records.get(start..start.checked_add(24)?)?)
    }
}

fn cartesian16(bytes: &[u8]) -> Option<LivoxPoint> {
    let [x0, x1, y0, y1, z0, z1, reflectivity, tag] = *bytes.first_chunk()?;
    let metres = |bytes| (f64::from(i16::from_le_bytes(bytes)) * 1e-2) as f32;
    Some(LivoxPoint { position: [metres([x0, x1]), metres([y0, y1]), metres([z0, z1])], reflectivity, tag })
}

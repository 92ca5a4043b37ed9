//! The records of a data datagram.

use super::header::{DataHeader, DataType, DatagramError, HEADER_BYTES};

/// One data datagram: its header, and its records, which are decoded when they are asked for.
#[derive(Debug, Clone, Copy)]
pub struct Datagram<'a> {
    /// Clock, kind of records and status.
    pub header: DataHeader,
    records: &'a [u8],
}

/// One echo of one laser shot, in the LiDAR frame: x forward, y left, z up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LivoxPoint {
    /// Metres; the origin where nothing came back.
    pub position: [f32; 3],
    /// 0 to 150 diffuse, 151 to 255 retro-reflective.
    pub reflectivity: u8,
    /// Return number and confidence of extended types, otherwise 0.
    pub tag: u8,
}

/// One sample of a device's own IMU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuRecord {
    /// Angular velocity, rad/s.
    pub gyro: [f32; 3],
    /// Specific force, **g**.
    pub accel_g: [f32; 3],
}

impl<'a> Datagram<'a> {
    /// Checks a UDP payload. The number of records follows from its length.
    ///
    /// # Errors
    /// [`DatagramError`]: it is no data datagram of this protocol.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, DatagramError> {
        let header = DataHeader::parse(bytes)?;
        let records = bytes.get(HEADER_BYTES..).unwrap_or_default();
        let record = header.data_type.record_bytes();
        match records.len() % record {
            _ if records.len() < record => Err(DatagramError::TooShort(bytes.len())),
            0 => Ok(Self { header, records }),
            extra => Err(DatagramError::Remainder { record, extra }),
        }
    }

    /// Records: laser shots, or IMU samples.
    pub fn shots(&self) -> usize {
        self.records.len() / self.header.data_type.record_bytes()
    }

    /// Points of all echoes; 0 for an IMU datagram.
    pub fn points(&self) -> usize {
        self.shots() * self.header.data_type.echoes()
    }

    /// Point `index`; the echoes of one shot follow each other, so its shot is `index / echoes`.
    #[inline]
    pub fn point(&self, index: usize) -> Option<LivoxPoint> {
        let echoes = self.header.data_type.echoes();
        let (shot, echo) = (index.checked_div(echoes)?, index.checked_rem(echoes)?);
        let record = self.record(shot)?;
        match self.header.data_type {
            DataType::Cartesian => cartesian(record),
            DataType::ExtendedCartesian | DataType::DualCartesian | DataType::TripleCartesian => {
                extended_cartesian(record.get(echo * 14..)?)
            }
            DataType::Spherical => spherical(record, record.get(4..)?, false),
            DataType::ExtendedSpherical => spherical(record, record.get(4..)?, true),
            DataType::DualSpherical | DataType::TripleSpherical => multi_spherical(record, echo),
            DataType::Imu => None,
        }
    }

    /// IMU sample `index`; `None` for a datagram of points.
    pub fn imu(&self, index: usize) -> Option<ImuRecord> {
        if self.header.data_type != DataType::Imu {
            return None;
        }
        imu(self.record(index)?)
    }

    #[inline]
    fn record(&self, index: usize) -> Option<&'a [u8]> {
        let size = self.header.data_type.record_bytes();
        let start = index.checked_mul(size)?;
        self.records.get(start..start.checked_add(size)?)
    }
}

/// A record of an IMU's six `f32`.
pub(crate) fn imu(record: &[u8]) -> Option<ImuRecord> {
    let mut values = [0.0; 6];
    for (value, bytes) in values.iter_mut().zip(record.first_chunk::<24>()?.as_chunks::<4>().0) {
        *value = f32::from_le_bytes(*bytes);
    }
    let [gx, gy, gz, ax, ay, az] = values;
    Some(ImuRecord { gyro: [gx, gy, gz], accel_g: [ax, ay, az] })
}

#[inline]
fn cartesian(bytes: &[u8]) -> Option<LivoxPoint> {
    let [x0, x1, x2, x3, y0, y1, y2, y3, z0, z1, z2, z3, reflectivity] = *bytes.first_chunk()?;
    let metres = |bytes| (f64::from(i32::from_le_bytes(bytes)) * 1e-3) as f32;
    let position = [metres([x0, x1, x2, x3]), metres([y0, y1, y2, y3]), metres([z0, z1, z2, z3])];
    Some(LivoxPoint { position, reflectivity, tag: 0 })
}

/// 14 bytes: x, y, z, reflectivity and tag.
#[inline]
pub(crate) fn extended_cartesian(bytes: &[u8]) -> Option<LivoxPoint> {
    Some(LivoxPoint { tag: *bytes.get(13)?, ..cartesian(bytes)? })
}

/// A record that begins with its depth; `angles` are the zenith and azimuth, reflectivity and perhaps a tag behind it.
pub(crate) fn spherical(depth: &[u8], angles: &[u8], tagged: bool) -> Option<LivoxPoint> {
    let reflectivity = *angles.get(4)?;
    let tag = if tagged { *angles.get(5)? } else { 0 };
    Some(LivoxPoint { position: position(depth, angles)?, reflectivity, tag })
}

/// A record that begins with its angles, followed by depth, reflectivity and tag of each echo.
fn multi_spherical(record: &[u8], echo: usize) -> Option<LivoxPoint> {
    let bytes = record.get(4 + echo * 6..)?;
    Some(LivoxPoint { position: position(bytes, record)?, reflectivity: *bytes.get(4)?, tag: *bytes.get(5)? })
}

/// x = d sin(zenith) cos(azimuth), y = d sin(zenith) sin(azimuth), z = d cos(zenith).
fn position(depth: &[u8], angles: &[u8]) -> Option<[f32; 3]> {
    let depth = f64::from(u32::from_le_bytes(*depth.first_chunk()?)) * 1e-3;
    let [t0, t1, p0, p1] = *angles.first_chunk()?;
    let radians = |bytes| (f64::from(u16::from_le_bytes(bytes)) * 0.01).to_radians();
    let ((sin_zenith, cos_zenith), (sin, cos)) = (radians([t0, t1]).sin_cos(), radians([p0, p1]).sin_cos());
    Some([depth * sin_zenith * cos, depth * sin_zenith * sin, depth * cos_zenith].map(|v| v as f32))
}

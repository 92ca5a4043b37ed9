//! `livox_ros_driver/CustomMsg`, byte for byte the same as `livox_ros_driver2/CustomMsg`.

use super::wire::{Encoding, Header, MessageError, Wire};
use super::writer::{Stamp, Writer};

const POINT_BYTES: usize = 19;

/// A frame of a Livox device.
#[derive(Debug, Clone, Copy)]
pub struct CustomMsg<'a> {
    /// Its stamp has passed through a double of seconds in driver 1: use `timebase_ns`.
    pub header: Header<'a>,
    /// Time of the first point, nanoseconds.
    pub timebase_ns: i64,
    /// Number of the device.
    pub lidar_id: u8,
    points: &'a [u8],
    count: usize,
    /// Bytes from point to point.
    stride: usize,
    big_endian: bool,
}

/// One point of a [`CustomMsg`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CustomPoint {
    /// Nanoseconds since the message's time base.
    pub offset_ns: u32,
    /// Metres; the origin where nothing came back.
    pub position: [f32; 3],
    /// 0 to 255.
    pub reflectivity: u8,
    /// Return number and confidence.
    pub tag: u8,
    /// Number of the laser line.
    pub line: u8,
}

impl<'a> CustomMsg<'a> {
    /// The message types with this layout.
    pub const TYPES: [&'static str; 2] = ["livox_ros_driver/CustomMsg", "livox_ros_driver2/CustomMsg"];

    /// Checks a serialised message.
    ///
    /// # Errors
    /// [`MessageError::Truncated`] and, for CDR, [`MessageError::Encapsulation`].
    pub fn parse(bytes: &'a [u8], encoding: Encoding) -> Result<Self, MessageError> {
        let mut wire = Wire::new(bytes, encoding)?;
        let header = wire.header()?;
        let timebase = wire.u64()?;
        let _point_num = wire.u32()?; // the array's own count is what the bytes follow
        let [lidar_id, ..] = wire.array::<4>()?;
        let count = wire.u32()? as usize;
        let stride = wire.stride(POINT_BYTES, 4);
        // The last point has nothing behind it.
        let length = count.saturating_mul(stride).saturating_sub(stride - POINT_BYTES);
        let points = wire.take(length)?;
        let timebase_ns = timebase.min(i64::MAX as u64) as i64;
        Ok(Self { header, timebase_ns, lidar_id, points, count, stride, big_endian: wire.big_endian })
    }

    /// Points in the message.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether the message has no points.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Point `index`.
    pub fn point(&self, index: usize) -> Option<CustomPoint> {
        let bytes = self.points.get(index.checked_mul(self.stride)?..)?.first_chunk::<POINT_BYTES>()?;
        let [numbers @ .., reflectivity, tag, line] = bytes;
        let [offset, position @ ..] = *numbers.as_chunks::<4>().0.first_chunk::<4>()?;
        let (offset_ns, position) = if self.big_endian {
            (u32::from_be_bytes(offset), position.map(f32::from_be_bytes))
        } else {
            (u32::from_le_bytes(offset), position.map(f32::from_le_bytes))
        };
        Some(CustomPoint { offset_ns, position, reflectivity: *reflectivity, tag: *tag, line: *line })
    }
}

/// Appends a serialised message to `out`.
pub fn write_custom_msg(
    out: &mut Vec<u8>,
    encoding: Encoding,
    header: &Stamp<'_>,
    timebase_ns: i64,
    lidar_id: u8,
    points: &[CustomPoint],
) {
    let mut writer = Writer::new(out, encoding);
    writer.header(header);
    writer.u64(timebase_ns.cast_unsigned());
    writer.u32(points.len() as u32);
    writer.raw(&[lidar_id, 0, 0, 0]);
    writer.u32(points.len() as u32);
    for point in points {
        writer.u32(point.offset_ns);
        for axis in point.position {
            writer.f32(axis);
        }
        writer.raw(&[point.reflectivity, point.tag, point.line]);
    }
}

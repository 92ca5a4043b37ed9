//! `livox_ros_driver/CustomMsg`, byte for byte the same as `livox_ros_driver2/CustomMsg`.

use super::wire::{Header, MessageError, Wire};

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
    points: &'a [[u8; POINT_BYTES]],
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
    /// [`MessageError::Truncated`].
    pub fn parse(bytes: &'a [u8]) -> Result<Self, MessageError> {
        let mut wire = Wire::new(bytes);
        let header = wire.header()?;
        let timebase = wire.u64()?;
        let _point_num = wire.u32()?; // the array's own count is what the bytes follow
        let [lidar_id, ..] = wire.array::<4>()?;
        let count = wire.u32()? as usize;
        let points = wire.take(count.saturating_mul(POINT_BYTES))?.as_chunks().0;
        Ok(Self { header, timebase_ns: timebase.min(i64::MAX as u64) as i64, lidar_id, points })
    }

    /// Points in the message.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether the message has no points.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Point `index`.
    pub fn point(&self, index: usize) -> Option<CustomPoint> {
        let [t0, t1, t2, t3, x0, x1, x2, x3, y0, y1, y2, y3, z0, z1, z2, z3, reflectivity, tag, line] =
            *self.points.get(index)?;
        Some(CustomPoint {
            offset_ns: u32::from_le_bytes([t0, t1, t2, t3]),
            position: [[x0, x1, x2, x3], [y0, y1, y2, y3], [z0, z1, z2, z3]].map(f32::from_le_bytes),
            reflectivity,
            tag,
            line,
        })
    }
}

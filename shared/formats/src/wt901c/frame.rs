//! One frame: 0x55, id, four little-endian words, sum.

/// Bytes of every frame.
pub const FRAME_BYTES: usize = 11;

/// First byte of every frame.
pub(super) const START: u8 = 0x55;

/// Ids of frames.
pub mod id {
    /// Date and time of the module's own clock, 1 ms resolution.
    pub const TIME: u8 = 0x50;
    /// Specific force x, y, z and temperature.
    pub const ACCEL: u8 = 0x51;
    /// Angular velocity x, y, z and supply voltage.
    pub const GYRO: u8 = 0x52;
    /// Roll, pitch, yaw and version.
    pub const ANGLE: u8 = 0x53;
    /// Magnetic field x, y, z and temperature.
    pub const MAGNETOMETER: u8 = 0x54;
    /// States of the ports D0 to D3.
    pub const PORTS: u8 = 0x55;
    /// Pressure and height.
    pub const PRESSURE: u8 = 0x56;
    /// Longitude and latitude.
    pub const POSITION: u8 = 0x57;
    /// Height, heading and speed by satellites.
    pub const GPS: u8 = 0x58;
    /// Quaternion q0 to q3.
    pub const QUATERNION: u8 = 0x59;
    /// Satellites and dilutions of precision.
    pub const ACCURACY: u8 = 0x5a;
    /// Answer to a read: four registers.
    pub const REGISTERS: u8 = 0x5f;
}

/// A frame whose sum is right.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Kind of the frame, 0x50 to 0x5A or 0x5F; see [`id`].
    pub id: u8,
    /// The eight bytes between the id and the sum.
    pub payload: [u8; 8],
    /// Where its first byte lies in the stream.
    pub offset: u64,
}

impl Frame {
    /// The payload as four signed words.
    pub fn words(&self) -> [i16; 4] {
        let [a, b, c, d, e, f, g, h] = self.payload;
        [[a, b], [c, d], [e, f], [g, h]].map(i16::from_le_bytes)
    }

    /// The first three words: an x, y, z triple.
    pub fn triple(&self) -> [i16; 3] {
        let [x, y, z, _] = self.words();
        [x, y, z]
    }

    /// Nanoseconds since 1970 on the module's clock; `None` if this is no time frame or holds no valid date.
    pub fn time_ns(&self) -> Option<i64> {
        let [year, month, day, hour, minute, second, ms0, ms1] = self.payload;
        let milliseconds = i64::from(u16::from_le_bytes([ms0, ms1]));
        if self.id != id::TIME || milliseconds > 999 {
            return None;
        }
        let seconds = crate::utc::seconds(2000 + i64::from(year), month, day, hour, minute, second)?;
        Some(seconds * 1_000_000_000 + milliseconds * 1_000_000)
    }
}

pub(super) fn is_known(id: u8) -> bool {
    matches!(id, 0x50..=0x5a | 0x5f)
}

pub(super) fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

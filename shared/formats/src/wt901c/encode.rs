//! Frames as the module sends them, for recordings of simulated walks.

use super::frame::{FRAME_BYTES, START, id, sum};

/// Frame 0x51: raw specific force (see [`super::Scales`]) and temperature in 0.01 degrees Celsius.
pub fn encode_accel(raw: [i16; 3], temperature: i16) -> [u8; FRAME_BYTES] {
    encode_words(id::ACCEL, with(raw, temperature))
}

/// Frame 0x52: raw angular velocity (see [`super::Scales`]) and supply voltage in 0.01 V.
pub fn encode_gyro(raw: [i16; 3], voltage: i16) -> [u8; FRAME_BYTES] {
    encode_words(id::GYRO, with(raw, voltage))
}

/// Frame 0x50: nanoseconds since 1970, cut to milliseconds; `None` outside the years 2000 to 2255.
pub fn encode_time(time_ns: i64) -> Option<[u8; FRAME_BYTES]> {
    let (year, month, day, hour, minute, second) = crate::utc::civil(time_ns.div_euclid(1_000_000_000));
    let year = u8::try_from(year - 2000).ok()?;
    let milliseconds = (time_ns.rem_euclid(1_000_000_000) / 1_000_000) as u16;
    let [ms0, ms1] = milliseconds.to_le_bytes();
    Some(encode(id::TIME, [year, month, day, hour, minute, second, ms0, ms1]))
}

/// A frame of four words.
pub fn encode_words(id: u8, words: [i16; 4]) -> [u8; FRAME_BYTES] {
    let [[a, b], [c, d], [e, f], [g, h]] = words.map(i16::to_le_bytes);
    encode(id, [a, b, c, d, e, f, g, h])
}

/// A frame of any kind.
pub fn encode(id: u8, [a, b, c, d, e, f, g, h]: [u8; 8]) -> [u8; FRAME_BYTES] {
    let mut bytes = [START, id, a, b, c, d, e, f, g, h, 0];
    bytes[FRAME_BYTES - 1] = sum(&bytes);
    bytes
}

fn with([x, y, z]: [i16; 3], last: i16) -> [i16; 4] {
    [x, y, z, last]
}

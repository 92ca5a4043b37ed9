//! `std_msgs/UInt8MultiArray`: bytes of any other format that ROS tools can record, play and copy.

use super::wire::{Encoding, MessageError, Wire};
use super::writer::Writer;

/// Appends a serialised message to `out` that holds the parts one after the other.
pub fn write_octets(out: &mut Vec<u8>, encoding: Encoding, parts: &[&[u8]]) {
    let mut writer = Writer::new(out, encoding);
    writer.u32(0); // no dimensions
    writer.u32(0); // offset of the data
    writer.u32(parts.iter().map(|part| part.len()).sum::<usize>() as u32);
    for part in parts {
        writer.raw(part);
    }
}

/// The bytes of a serialised message.
///
/// # Errors
/// [`MessageError::Truncated`] and, for CDR, [`MessageError::Encapsulation`].
pub fn octets(bytes: &[u8], encoding: Encoding) -> Result<&[u8], MessageError> {
    let mut wire = Wire::new(bytes, encoding)?;
    for _ in 0..wire.u32()? {
        wire.string()?; // label
        wire.u32()?; // size
        wire.u32()?; // stride
    }
    wire.u32()?; // offset of the data
    wire.counted_bytes()
}

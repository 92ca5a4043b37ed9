//! Data datagrams as a device sends them.

use super::frame::crc32;
use super::header::{CHECKED_FROM, DataType, HEADER_BYTES, TimeType};
use crate::livox_sdk1::PointRecord;

/// The fields of a header that do not follow from the records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DataFields {
    /// Time of the last shot less time of the first, in units of 100 ns.
    pub interval: u16,
    /// Number of the datagram.
    pub number: u16,
    /// Number of the frame.
    pub frame: u8,
    /// Source of the clock.
    pub time_type: TimeType,
    /// Time of the first record in nanoseconds of the device's clock.
    pub stamp_ns: u64,
}

/// Replaces `out` by a datagram of points; of `DualCartesian` two points are one shot. Values that the type cannot hold are
/// cut to its bits; no points for [`DataType::Imu`].
pub fn encode_points(data_type: DataType, fields: &DataFields, points: &[PointRecord], out: &mut Vec<u8>) {
    let Some(shots) = points.len().checked_div(data_type.echoes()) else { return out.clear() };
    start(data_type, fields, shots, out);
    for point in points.iter().take(shots * data_type.echoes()) {
        let [a, b, c] = point.values;
        match data_type {
            DataType::Cartesian16 => {
                for value in [a, b, c] {
                    out.extend_from_slice(&(value as i16).to_le_bytes());
                }
            }
            DataType::Spherical => {
                out.extend_from_slice(&a.to_le_bytes());
                out.extend_from_slice(&(b as u16).to_le_bytes());
                out.extend_from_slice(&(c as u16).to_le_bytes());
            }
            _ => {
                for value in [a, b, c] {
                    out.extend_from_slice(&value.to_le_bytes());
                }
            }
        }
        out.extend_from_slice(&[point.reflectivity, point.tag]);
    }
    finish(out);
}

/// Replaces `out` by a datagram with one IMU sample: rad/s and **g**.
pub fn encode_imu(fields: &DataFields, gyro: [f32; 3], accel_g: [f32; 3], out: &mut Vec<u8>) {
    start(DataType::Imu, fields, 1, out);
    for value in gyro.into_iter().chain(accel_g) {
        out.extend_from_slice(&value.to_le_bytes());
    }
    finish(out);
}

fn start(data_type: DataType, fields: &DataFields, records: usize, out: &mut Vec<u8>) {
    out.clear();
    out.reserve(HEADER_BYTES + records * data_type.record_bytes());
    out.extend_from_slice(&[0, 0, 0]);
    out.extend_from_slice(&fields.interval.to_le_bytes());
    out.extend_from_slice(&(records as u16).to_le_bytes());
    out.extend_from_slice(&fields.number.to_le_bytes());
    out.extend_from_slice(&[fields.frame, data_type as u8, fields.time_type as u8]);
    out.extend_from_slice(&[0; 16]);
    out.extend_from_slice(&fields.stamp_ns.to_le_bytes());
}

/// Writes length and checksum, which are known only now.
fn finish(out: &mut [u8]) {
    let length = (out.len() as u16).to_le_bytes();
    let checksum = crc32(out.get(CHECKED_FROM..).unwrap_or_default()).to_le_bytes();
    for (at, bytes) in [(1, &length[..]), (24, &checksum[..])] {
        if let Some(to) = out.get_mut(at..at + bytes.len()) {
            to.copy_from_slice(bytes);
        }
    }
}

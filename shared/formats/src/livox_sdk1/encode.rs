//! Datagrams as a Mid-40 (points) and a Livox device with an IMU would send them, for recordings of simulated walks.

use super::header::{DataType, HEADER_BYTES, TimestampType};

/// Shots in a Mid-40's datagram: 1 ms.
pub const DATAGRAM_SHOTS: usize = 100;

/// One shot of a Mid-40: millimetres in the LiDAR frame and reflectivity; all zero where nothing came back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CartesianMm {
    /// Millimetres.
    pub position: [i32; 3],
    /// See [`super::LivoxPoint::reflectivity`].
    pub reflectivity: u8,
}

/// Replaces `out` by a datagram of data type 0 whose first shot is at `stamp_ns` since power-on.
pub fn encode_cartesian(stamp_ns: u64, shots: &[CartesianMm], out: &mut Vec<u8>) {
    header(DataType::Cartesian, stamp_ns, out);
    for shot in shots {
        for coordinate in shot.position {
            out.extend_from_slice(&coordinate.to_le_bytes());
        }
        out.push(shot.reflectivity);
    }
}

/// Replaces `out` by a datagram of data type 6: rad/s and **g**, at `stamp_ns` since power-on.
pub fn encode_imu(stamp_ns: u64, gyro: [f32; 3], accel_g: [f32; 3], out: &mut Vec<u8>) {
    header(DataType::Imu, stamp_ns, out);
    for value in gyro.into_iter().chain(accel_g) {
        out.extend_from_slice(&value.to_le_bytes());
    }
}

fn header(data_type: DataType, stamp_ns: u64, out: &mut Vec<u8>) {
    out.clear();
    out.reserve(HEADER_BYTES + DATAGRAM_SHOTS * data_type.record_bytes());
    // version, slot, LiDAR id, reserved, and a status word without complaints
    out.extend_from_slice(&[5, 1, 1, 0, 0, 0, 0, 0]);
    out.extend_from_slice(&[TimestampType::PowerOn as u8, data_type as u8]);
    out.extend_from_slice(&stamp_ns.to_le_bytes());
}

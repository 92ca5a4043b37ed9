//! Data datagrams as devices send them.

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

/// One echo in the units of the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PointRecord {
    /// Coordinates, or depth, zenith and azimuth (in 0.01 degrees), as the data type says. Echoes of one shot share its angles.
    pub values: [i32; 3],
    /// See [`super::LivoxPoint::reflectivity`].
    pub reflectivity: u8,
    /// Return number and confidence, where the data type has them.
    pub tag: u8,
}

/// The fields of a header that do not follow from the records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DataFields {
    /// Status word.
    pub status: u32,
    /// Source of the clock.
    pub timestamp_type: TimestampType,
    /// The stamp as it stands on the wire: nanoseconds, or a [`super::UtcTime`].
    pub stamp: [u8; 8],
}

impl DataFields {
    /// A device without complaints and with no other clock than its own, at `stamp_ns` since power-on.
    pub fn power_on(stamp_ns: u64) -> Self {
        Self { status: 0, timestamp_type: TimestampType::PowerOn, stamp: stamp_ns.to_le_bytes() }
    }
}

/// Replaces `out` by a datagram of data type 0 whose first shot is at `stamp_ns` since power-on.
pub fn encode_cartesian(stamp_ns: u64, shots: &[CartesianMm], out: &mut Vec<u8>) {
    header(DataType::Cartesian, &DataFields::power_on(stamp_ns), shots.len(), out);
    for shot in shots {
        for coordinate in shot.position {
            out.extend_from_slice(&coordinate.to_le_bytes());
        }
        out.push(shot.reflectivity);
    }
}

/// Replaces `out` by a datagram of points; the echoes of one shot follow each other. No points for [`DataType::Imu`].
pub fn encode_points(data_type: DataType, fields: &DataFields, points: &[PointRecord], out: &mut Vec<u8>) {
    use DataType::{DualSpherical, ExtendedSpherical, Spherical, TripleSpherical};
    let Some(shots) = points.len().checked_div(data_type.echoes()) else { return out.clear() };
    header(data_type, fields, shots, out);
    let tagged = !matches!(data_type, DataType::Cartesian | Spherical);
    for shot in points.chunks_exact(data_type.echoes()) {
        let several = matches!(data_type, DualSpherical | TripleSpherical);
        if let (true, [first, ..]) = (several, shot) {
            angles(first, out);
        }
        for echo in shot {
            match data_type {
                Spherical | ExtendedSpherical | DualSpherical | TripleSpherical => {
                    out.extend_from_slice(&echo.values[0].to_le_bytes());
                    if !several {
                        angles(echo, out);
                    }
                }
                _ => echo.values.iter().for_each(|value| out.extend_from_slice(&value.to_le_bytes())),
            }
            out.push(echo.reflectivity);
            if tagged {
                out.push(echo.tag);
            }
        }
    }
}

fn angles(point: &PointRecord, out: &mut Vec<u8>) {
    let [_, zenith, azimuth] = point.values;
    out.extend_from_slice(&(zenith as u16).to_le_bytes());
    out.extend_from_slice(&(azimuth as u16).to_le_bytes());
}

/// Replaces `out` by a datagram of data type 6: rad/s and **g**.
pub fn encode_imu(fields: &DataFields, gyro: [f32; 3], accel_g: [f32; 3], out: &mut Vec<u8>) {
    header(DataType::Imu, fields, 1, out);
    for value in gyro.into_iter().chain(accel_g) {
        out.extend_from_slice(&value.to_le_bytes());
    }
}

fn header(data_type: DataType, fields: &DataFields, records: usize, out: &mut Vec<u8>) {
    out.clear();
    out.reserve(HEADER_BYTES + records * data_type.record_bytes());
    // version, slot, LiDAR id, reserved
    out.extend_from_slice(&[5, 1, 1, 0]);
    out.extend_from_slice(&fields.status.to_le_bytes());
    out.extend_from_slice(&[fields.timestamp_type as u8, data_type as u8]);
    out.extend_from_slice(&fields.stamp);
}

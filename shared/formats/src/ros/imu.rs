//! `sensor_msgs/Imu`.

use super::wire::{Encoding, Header, MessageError, Wire};
use super::writer::{Stamp, Writer};

/// One IMU sample.
#[derive(Debug, Clone, Copy)]
pub struct Imu<'a> {
    /// Time of the sample.
    pub header: Header<'a>,
    /// rad/s.
    pub gyro: [f64; 3],
    /// m/s^2 by the definition of the message, but **g** as Livox drivers publish it.
    pub accel: [f64; 3],
}

impl<'a> Imu<'a> {
    /// The message type with this layout.
    pub const TYPE: &'static str = "sensor_msgs/Imu";

    /// Reads a serialised message.
    ///
    /// # Errors
    /// [`MessageError::Truncated`] and, for CDR, [`MessageError::Encapsulation`].
    pub fn parse(bytes: &'a [u8], encoding: Encoding) -> Result<Self, MessageError> {
        let mut wire = Wire::new(bytes, encoding)?;
        let header = wire.header()?;
        let _orientation: [f64; 4] = wire.f64s()?;
        let _covariance: [f64; 9] = wire.f64s()?;
        let gyro = wire.f64s()?;
        let _covariance: [f64; 9] = wire.f64s()?;
        let accel = wire.f64s()?;
        let _covariance: [f64; 9] = wire.f64s()?;
        Ok(Self { header, gyro, accel })
    }
}

/// Appends a serialised message to `out`: rad/s and m/s^2, or g as Livox drivers publish it.
///
/// `orientation_covariance` begins with -1 where the orientation is not known, by the message's definition; Livox
/// drivers leave it 0.
pub fn write_imu(
    out: &mut Vec<u8>,
    encoding: Encoding,
    header: &Stamp<'_>,
    gyro: [f64; 3],
    accel: [f64; 3],
    orientation_covariance: [f64; 9],
) {
    let mut writer = Writer::new(out, encoding);
    writer.header(header);
    writer.f64s(&[0.0; 4]);
    writer.f64s(&orientation_covariance);
    writer.f64s(&gyro);
    writer.f64s(&[0.0; 9]);
    writer.f64s(&accel);
    writer.f64s(&[0.0; 9]);
}

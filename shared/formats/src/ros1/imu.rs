//! `sensor_msgs/Imu`.

use super::wire::{Header, MessageError, Wire};

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
    /// [`MessageError::Truncated`].
    pub fn parse(bytes: &'a [u8]) -> Result<Self, MessageError> {
        const COVARIANCE: usize = 9 * 8;
        let mut wire = Wire::new(bytes);
        let header = wire.header()?;
        wire.take(4 * 8 + COVARIANCE)?; // orientation
        let gyro = wire.vector()?;
        wire.take(COVARIANCE)?;
        let accel = wire.vector()?;
        wire.take(COVARIANCE)?;
        Ok(Self { header, gyro, accel })
    }
}

//! What the frames beside time, accelerometer and gyroscope say, in units.

use super::frame::{Frame, id};
use super::sample::Scales;

/// Content of one frame, in the module's axes. Units are SI but where a field says so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// 0x50: nanoseconds since 1970 on the module's own clock, which starts at an arbitrary date.
    Time(i64),
    /// 0x51.
    Accel {
        /// m/s^2.
        accel: [f64; 3],
        /// Degrees Celsius.
        temperature_c: f64,
    },
    /// 0x52.
    Gyro {
        /// rad/s.
        gyro: [f64; 3],
    },
    /// 0x53: roll, pitch and yaw, radians. Yaw leans on the magnetometer where the module runs its algorithm of nine axes.
    Angles {
        /// Roll, pitch, yaw.
        roll_pitch_yaw: [f64; 3],
        /// Version of the firmware.
        version: u16,
    },
    /// 0x54: raw words, whose unit depends on the chip.
    Magnetometer([i16; 3]),
    /// 0x55: states of the ports D0 to D3.
    Ports([i16; 4]),
    /// 0x56.
    Pressure {
        /// Pascal.
        pressure_pa: i32,
        /// Metres.
        height_m: f64,
    },
    /// 0x57: the words of longitude and latitude, ddmm.mmmmm times 1e7 as in NMEA.
    Position {
        /// Longitude.
        longitude: i32,
        /// Latitude.
        latitude: i32,
    },
    /// 0x58.
    Gps {
        /// Metres.
        height_m: f64,
        /// Radians.
        heading: f64,
        /// m/s.
        speed_m_s: f64,
    },
    /// 0x59: q0 to q3 in the vendor's order, q0 being its scalar. One public driver takes them as x, y, z, w instead: compare with
    /// the angles before use.
    Quaternion([f64; 4]),
    /// 0x5a: satellites, and dilutions of precision (position, horizontal, vertical) in hundredths.
    Accuracy([i16; 4]),
    /// 0x5f: four registers from the address that was asked for, which the frame does not say.
    Registers([u16; 4]),
}

impl Frame {
    /// What the frame says; `None` for a time that is no date.
    pub fn reading(&self, scales: &Scales) -> Option<Reading> {
        let words = self.words();
        let [a, b, c, d, e, f, g, h] = self.payload;
        let (low, high) = (i32::from_le_bytes([a, b, c, d]), i32::from_le_bytes([e, f, g, h]));
        Some(match self.id {
            id::TIME => Reading::Time(self.time_ns()?),
            id::ACCEL => Reading::Accel {
                accel: scales.accel(self.triple()),
                temperature_c: f64::from(words[3]) / 100.0,
            },
            id::GYRO => Reading::Gyro { gyro: scales.gyro(self.triple()) },
            id::ANGLE => Reading::Angles {
                roll_pitch_yaw: self.triple().map(|word| f64::from(word) / 32768.0 * std::f64::consts::PI),
                version: words[3].cast_unsigned(),
            },
            id::MAGNETOMETER => Reading::Magnetometer(self.triple()),
            id::PORTS => Reading::Ports(words),
            id::PRESSURE => Reading::Pressure { pressure_pa: low, height_m: f64::from(high) / 100.0 },
            id::POSITION => Reading::Position { longitude: low, latitude: high },
            id::GPS => Reading::Gps {
                height_m: f64::from(words[0]) / 10.0,
                heading: (f64::from(words[1]) / 100.0).to_radians(),
                speed_m_s: f64::from(high) / 1000.0 / 3.6,
            },
            id::QUATERNION => Reading::Quaternion(words.map(|word| f64::from(word) / 32768.0)),
            id::ACCURACY => Reading::Accuracy(words),
            id::REGISTERS => Reading::Registers(words.map(i16::cast_unsigned)),
            _ => return None,
        })
    }
}

//! Which module, and how it should be set.

use std::path::PathBuf;

use evac_formats::wt901c::{FRAME_BYTES, bandwidth_code, baud_code, content, rate_code};
use evac_stage::{StageConfig, check_range};
use serde::{Deserialize, Serialize};

/// Share of a line's capacity that samples may take.
const FULLEST: f64 = 0.9;

/// What a module speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Protocol {
    /// TTL or RS232: it streams frames.
    Serial,
    /// RS485 (WT901C485): it is asked over Modbus RTU, sample by sample.
    Modbus,
}

/// Configuration of the IMU driver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Serial port. The udev rule in `launch/udev` gives a USB adapter this name.
    pub port: PathBuf,
    /// Part of a name in `/dev/serial/by-id`, instead of `port`: the adapter's own, which it keeps on every socket.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub usb_id: Option<String>,
    /// What the module speaks.
    pub protocol: Protocol,
    /// Address of a Modbus module.
    pub address: u8,
    /// Samples per second. The paper's 200 Hz.
    pub rate_hz: f64,
    /// Speed that the module is set to; found at any other.
    pub baud: u32,
    /// Bandwidth of the module's low-pass filter. Its default of 21 Hz delays and smooths a walker's motion.
    pub bandwidth_hz: u32,
    /// Frame 0x50 with each sample: 11 bytes that show lost samples, and steps of the module's clock.
    pub time: bool,
    /// Frame 0x53, roll, pitch and yaw, on `imu/attitude`.
    pub angles: bool,
    /// Frame 0x54, the magnetic field, on `imu/attitude`.
    pub magnetometer: bool,
    /// Frame 0x59 on `imu/attitude`.
    pub quaternion: bool,
    /// The module's own attitude without its magnetometer, which steel and motors mislead.
    pub six_axes: bool,
    /// Set the module. Without it, it is taken as it is.
    pub configure: bool,
    /// Keep new settings in the module over a power cycle.
    pub save: bool,
    /// One g in m/s^2; the vendor calculates with 9.8.
    pub one_g_m_s2: f64,
    /// Range of the accelerometer's words, g.
    pub accel_range_g: f64,
    /// Range of the gyroscope's words, degrees/s.
    pub gyro_range_dps: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            port: PathBuf::from("/dev/evac-imu"),
            usb_id: None,
            protocol: Protocol::Serial,
            address: 0x50,
            rate_hz: 200.0,
            baud: 115_200,
            bandwidth_hz: 184,
            time: true,
            angles: false,
            magnetometer: false,
            quaternion: false,
            six_axes: true,
            configure: true,
            save: true,
            one_g_m_s2: 9.80665,
            accel_range_g: 16.0,
            gyro_range_dps: 2000.0,
        }
    }
}

impl Config {
    /// Bits of the register that says which frames a sample has.
    pub(crate) fn content(&self) -> u16 {
        let optional = [
            (self.time, content::TIME),
            (self.angles, content::ANGLE),
            (self.magnetometer, content::MAGNETOMETER),
            (self.quaternion, content::QUATERNION),
        ];
        let wanted = optional.iter().filter(|(wanted, _)| *wanted).map(|(_, bit)| bit);
        wanted.fold(content::ACCEL | content::GYRO, |all, bit| all | bit)
    }

    fn check_load(&self) -> Result<(), String> {
        let frames = self.content().count_ones();
        let bits = self.rate_hz * f64::from(frames) * FRAME_BYTES as f64 * 10.0;
        if bits <= FULLEST * f64::from(self.baud) {
            return Ok(());
        }
        Err(format!(
            "{frames} frames at {} Hz are {bits:.0} bit/s, too many for baud = {}: raise baud, or leave frames out",
            self.rate_hz, self.baud
        ))
    }
}

impl StageConfig for Config {
    fn check(&self) -> Result<(), String> {
        check_range("one_g_m_s2", self.one_g_m_s2, 9.7, 9.9, "leave it out for standard gravity")?;
        check_range("accel_range_g", self.accel_range_g, 1.0, 100.0, "leave it out for the WT901C's 16 g")?;
        check_range("gyro_range_dps", self.gyro_range_dps, 100.0, 10_000.0, "leave it out for 2000")?;
        check_range("rate_hz", self.rate_hz, 10.0, 200.0, "the WT901C sends up to 200")?;
        if rate_code(self.rate_hz).is_none() {
            return Err(format!("rate_hz = {} is none the module knows: 10, 20, 50, 100, 200", self.rate_hz));
        }
        if baud_code(self.baud).is_none() {
            return Err(format!(
                "baud = {} is none the module knows: 9600, 19200, 38400, 57600, 115200, 230400, 460800 or 921600",
                self.baud
            ));
        }
        if bandwidth_code(self.bandwidth_hz).is_none() {
            return Err(format!(
                "bandwidth_hz = {} is none the module knows: 5, 10, 21, 44, 94, 184, 256",
                self.bandwidth_hz
            ));
        }
        if !(1..=0x7f).contains(&self.address) {
            return Err(format!("address = {} must lie between 1 and 127", self.address));
        }
        if self.protocol == Protocol::Serial { self.check_load() } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_valid_and_survive_toml() {
        assert_eq!(Config::default().check(), Ok(()));
        let text = toml::to_string(&Config::default()).unwrap();
        assert_eq!(toml::from_str::<Config>(&text).unwrap(), Config::default());
        assert!(toml::from_str::<Config>("prot = \"/dev/ttyUSB0\"").is_err());
    }

    #[test]
    fn what_the_module_does_not_know_or_the_line_cannot_carry_is_refused_by_name() {
        let all = Config { angles: true, magnetometer: true, quaternion: true, ..Config::default() };
        for (config, word) in [
            (Config { rate_hz: 125.0, ..Config::default() }, "rate_hz = 125"),
            (Config { baud: 250_000, ..Config::default() }, "baud = 250000"),
            (Config { bandwidth_hz: 100, ..Config::default() }, "bandwidth_hz = 100"),
            (Config { baud: 57_600, ..Config::default() }, "raise baud"),
            (all.clone(), "6 frames at 200 Hz"),
        ] {
            let refusal = config.check().unwrap_err();
            assert!(refusal.contains(word), "{refusal}");
        }
        assert_eq!(Config { baud: 230_400, ..all }.check(), Ok(()));
    }
}

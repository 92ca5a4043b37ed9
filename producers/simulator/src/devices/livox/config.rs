//! What a simulated LiDAR can be told.

use std::net::Ipv4Addr;

use evac_stage::check_range;
use serde::{Deserialize, Serialize};

/// Livox's wire protocols.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LivoxProtocol {
    /// As a Mid-40: 100 shots a packet. With an IMU as an Avia, by its packets: 96 shots with tags. The shots stay a Mid-40's.
    Sdk1,
    /// As a Mid-360, by its packets: 96 shots each. The shots stay a Mid-40's.
    Sdk2,
}

/// What the device's clock follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TimeSource {
    /// Time since power-on.
    PowerOn,
    /// A PTP master, here this computer's UTC.
    Ptp,
    /// UTC with a resolution of 1 us (first protocol), or GPS (second).
    Gps,
    /// Time since the last pulse (first protocol only).
    Pulse,
}

/// Configuration of a simulated LiDAR.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LivoxConfig {
    /// Wire protocol.
    pub protocol: LivoxProtocol,
    /// The device's own address; on the loopback interface any of 127.0.0.0/8 will do. Its ports are the real ones.
    pub address: Ipv4Addr,
    /// Where its broadcasts go: 255.255.255.255, or on the loopback interface the host's address.
    pub broadcast_to: Ipv4Addr,
    /// Broadcast code (15 characters), or serial number.
    pub serial: String,
    /// What its clock follows.
    pub time_source: TimeSource,
    /// Has an IMU of its own: 200 samples a second when they are asked for.
    pub imu: bool,
    /// Without heartbeats for so long a session ends, seconds (first protocol; assumed, the real device's is not published).
    pub session_s: f64,
    /// Time from power-on to readiness, seconds (a real Mid-40 takes some more).
    pub boot_s: f64,
}

impl Default for LivoxConfig {
    fn default() -> Self {
        Self {
            protocol: LivoxProtocol::Sdk1,
            address: Ipv4Addr::new(127, 0, 0, 40),
            broadcast_to: Ipv4Addr::LOCALHOST,
            serial: "0TFDG3B006H2Z11".to_owned(),
            time_source: TimeSource::PowerOn,
            imu: false,
            session_s: 5.0,
            boot_s: 1.0,
        }
    }
}

impl LivoxConfig {
    /// Checks ranges that types cannot express.
    ///
    /// # Errors
    /// One sentence naming the key, its value, the allowed range and what to try.
    pub fn check(&self) -> Result<(), String> {
        check_range("session_s", self.session_s, 1.0, 60.0, "5 is the default")?;
        check_range("boot_s", self.boot_s, 0.0, 60.0, "1 is the default")?;
        if self.serial.len() > 15 || !self.serial.is_ascii() {
            return Err(format!("serial = \"{}\" must have at most 15 ASCII characters", self.serial));
        }
        if self.time_source == TimeSource::Pulse && self.protocol == LivoxProtocol::Sdk2 {
            return Err("time_source = \"pulse\" belongs to protocol = \"sdk1\"; choose another".to_owned());
        }
        Ok(())
    }

    /// The serial number, zero padded.
    pub(super) fn code(&self) -> [u8; 16] {
        let mut code = [0; 16];
        for (to, from) in code.iter_mut().zip(self.serial.bytes()) {
            *to = from;
        }
        code
    }
}

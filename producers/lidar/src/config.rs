//! What the driver can be told, with every default in sight.

use std::net::Ipv4Addr;

use evac_stage::{StageConfig, check_range};
use serde::{Deserialize, Serialize};

/// Livox's wire protocols.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Protocol {
    /// Mid-40, Mid-70, Mid-100, Avia, Horizon, Tele-15.
    Sdk1,
    /// Mid-360, HAP.
    Sdk2,
}

/// Which echoes of a shot are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReturnMode {
    /// The first.
    First,
    /// The strongest.
    Strongest,
    /// Two.
    Dual,
    /// Three (Avia).
    Triple,
}

/// Configuration of the driver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Wire protocol of the device. The paper's Mid-40 speaks the first.
    pub protocol: Protocol,
    /// This computer's address on the LiDAR's network: nothing is received on any other, and the device is told to send here.
    /// (Its broadcasts are addressed to all; they are taken on this address's network only.) A Livox device expects
    /// 192.168.1.50 out of the box; the default reaches simulated devices only.
    pub interface: Ipv4Addr,
    /// The device's address; absent: the first device that is found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<Ipv4Addr>,
    /// Broadcast code (first protocol, 15 characters) or serial number (second protocol) of the device; absent: any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// Length of a scan, milliseconds, rounded to whole packets. The paper's 10 Hz.
    pub frame_ms: f64,
    /// Echoes to ask for; absent: what the device is set to. A Mid-40 has one and refuses the question.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub return_mode: Option<ReturnMode>,
    /// Passes the samples of the device's own IMU on as `imu/sample`, in place of a stage `imu`: Avia, Horizon, Tele-15, Mid-360,
    /// HAP. They are stamped by the same clock as the points. `[rig.imu_from_lidar]` then says where the LiDAR's origin lies
    /// from that IMU; the axes are parallel. Mid-360: translation_m = [-0.011, -0.02329, 0.04412]; Avia: [0.04165, 0.02326, -0.0284]
    /// (FAST-LIO's configurations, after the makers' manuals).
    pub publish_imu: bool,
    /// Time between two shots, nanoseconds; absent: told from the packets (10,000 or 4,167 by the first protocol; the
    /// second says it in each packet).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shot_ns: Option<u32>,
    /// Receive buffer to ask the system for, MiB: what arrives while this process does not run. The system gives no more
    /// than net.core.rmem_max; 4 MiB hold two seconds of a Mid-40.
    pub receive_buffer_mib: u32,
    /// Port of this computer for commands; 0: any. Firewalls may need a fixed one (the vendor's software: 55501, 56101).
    pub command_port: u16,
    /// Port of this computer for points and IMU samples; 0: any. (The vendor's software: 56001, 56301.)
    pub data_port: u16,
    /// Stops the laser when this process ends.
    pub stop_at_exit: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            protocol: Protocol::Sdk1,
            interface: Ipv4Addr::LOCALHOST,
            device: None,
            serial: None,
            frame_ms: 100.0,
            return_mode: None,
            publish_imu: false,
            shot_ns: None,
            receive_buffer_mib: 4,
            command_port: 0,
            data_port: 0,
            stop_at_exit: true,
        }
    }
}

impl StageConfig for Config {
    fn check(&self) -> Result<(), String> {
        check_range("frame_ms", self.frame_ms, 10.0, 150.0, "100 gives the paper's 10 scans a second")?;
        check_range("receive_buffer_mib", f64::from(self.receive_buffer_mib), 1.0, 256.0, "4 is plenty")?;
        if let Some(shot_ns) = self.shot_ns {
            check_range("shot_ns", f64::from(shot_ns), 1000.0, 100_000.0, "leave it out")?;
        }
        for (key, address) in [("interface", Some(self.interface)), ("device", self.device)] {
            if let Some(address) =
                address.filter(|a| a.is_unspecified() || a.is_broadcast() || a.is_multicast())
            {
                return Err(format!(
                    "{key} = \"{address}\" is no address of one machine; name the one on the LiDAR's network (`ip -4 addr`)"
                ));
            }
        }
        if self.device == Some(self.interface) {
            return Err(format!(
                "device and interface are both {}; interface is this computer's address, device the LiDAR's",
                self.interface
            ));
        }
        if self.interface.is_loopback() && self.protocol == Protocol::Sdk2 && self.device.is_none() {
            return Err("a device of the second protocol cannot be searched for on the loopback interface; name it with device"
                .to_owned());
        }
        let longest = match self.protocol {
            Protocol::Sdk1 => 15,
            Protocol::Sdk2 => 16,
        };
        if let Some(serial) = &self.serial
            && !(serial.is_ascii() && (1..=longest).contains(&serial.len()))
        {
            return Err(format!(
                "serial = \"{serial}\" must have 1 to {longest} ASCII characters; it stands on the device's label"
            ));
        }
        if self.return_mode.is_some() && self.protocol == Protocol::Sdk2 {
            return Err("return_mode belongs to protocol = \"sdk1\"; leave it out".to_owned());
        }
        Ok(())
    }
}

impl Config {
    /// Length of a scan, nanoseconds.
    pub(crate) fn frame_ns(&self) -> i64 {
        (self.frame_ms * 1e6) as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        toml::from_str::<Config>(text).unwrap().check().unwrap_err()
    }

    #[test]
    fn defaults_are_valid_and_survive_toml() {
        assert_eq!(Config::default().check(), Ok(()));
        let text = toml::to_string(&Config::default()).unwrap();
        assert_eq!(toml::from_str::<Config>(&text).unwrap(), Config::default());
        assert!(toml::from_str::<Config>("devise = \"10.0.0.1\"").is_err());
    }

    #[test]
    fn a_bad_value_is_named_with_what_to_do() {
        for frame_ms in ["9.9", "151.0", "nan"] {
            assert!(refused(&format!("frame_ms = {frame_ms}")).contains("10 and 150"));
        }
        assert!(refused("interface = \"0.0.0.0\"").contains("ip -4 addr"));
        assert!(refused("device = \"255.255.255.255\"").contains("device"));
        assert!(refused("device = \"127.0.0.1\"").contains("both"));
        assert!(refused("protocol = \"sdk2\"").contains("name it with device"));
        assert!(refused("serial = \"0TFDG3B006H2Z11X\"").contains("label"));
        assert!(
            refused("protocol = \"sdk2\"\ndevice = \"127.0.0.2\"\nreturn_mode = \"dual\"").contains("sdk1")
        );
    }
}

//! What to replay and how to read it.

use std::net::Ipv4Addr;
use std::path::PathBuf;

use evac_stage::StageConfig;
use serde::{Deserialize, Serialize};

/// Configuration of the replay: a capture or Livox recording with or without a byte log, or a bag.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Capture (classic pcap) of a Livox device's UDP packets, or a recording of Livox Viewer (LVX, LVX2).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lidar: Option<PathBuf>,
    /// Byte log of a WT901C. Without it the IMU packets inside the capture are used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub imu: Option<PathBuf>,
    /// Bag, instead of `lidar` and `imu`: ROS 1, or a file or folder of ROS 2 (MCAP, db3) or of evac's recorder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bag: Option<PathBuf>,
    /// Output rate of the WT901C. Its log is evenly sampled: sample k was measured at the first LiDAR packet's
    /// device time + k / rate + offset. The paper's 200 Hz.
    pub imu_rate_hz: f64,
    /// Added to the time of every IMU sample, milliseconds; for a log that did not start with the LiDAR, or to shift a
    /// bag's IMU.
    pub imu_offset_ms: f64,
    /// Address of the LiDAR to replay where several were captured; otherwise the first that sent points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lidar_ip: Option<Ipv4Addr>,
    /// Topic of the point clouds in a bag; otherwise the `CustomMsg` topic, or the `PointCloud2` topic without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lidar_topic: Option<String>,
    /// Topic of the IMU in a bag; otherwise the `Imu` topic with the most messages.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub imu_topic: Option<String>,
    /// Unit of the specific force in a bag's IMU messages.
    pub imu_unit: ImuUnit,
    /// Unit of the angular rate in a bag's IMU messages.
    pub gyro_unit: GyroUnit,
    /// One g in m/s^2, for sources that measure in g (WT901C, Livox). Standard gravity; the vendor of the WT901C
    /// calculates with 9.8.
    pub one_g_m_s2: f64,
    /// Length of a scan made of packets, milliseconds; a bag's messages stay as they are. The paper's 10 Hz.
    pub scan_period_ms: f64,
    /// Seconds of the recording that are left out at its start.
    pub start_s: f64,
    /// Seconds of the recording that are replayed, to the end of the scan in which they end; 0 for all.
    pub duration_s: f64,
    /// Use a cut-off recording up to where it ends, instead of refusing it.
    pub allow_truncated: bool,
}

/// Unit of specific force in `sensor_msgs/Imu`: m/s^2 by its definition, g as Livox drivers publish it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ImuUnit {
    /// Told apart by the length of the vector in the first two seconds: about 1 or about 9.8.
    #[serde(rename = "auto")]
    Auto,
    /// Metres per second squared.
    #[serde(rename = "m/s2")]
    MetresPerSecondSquared,
    /// Multiples of [`Config::one_g_m_s2`].
    #[serde(rename = "g")]
    G,
}

/// Unit of angular rate in `sensor_msgs/Imu`: rad/s by its definition, degrees/s as some drivers publish it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum GyroUnit {
    /// Rad/s, unless gravity shows in the first minute that it is degrees/s.
    #[serde(rename = "auto")]
    Auto,
    /// Radians per second.
    #[serde(rename = "rad/s")]
    RadiansPerSecond,
    /// Degrees per second.
    #[serde(rename = "deg/s")]
    DegreesPerSecond,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            lidar: None,
            imu: None,
            bag: None,
            imu_rate_hz: 200.0,
            imu_offset_ms: 0.0,
            lidar_ip: None,
            lidar_topic: None,
            imu_topic: None,
            imu_unit: ImuUnit::Auto,
            gyro_unit: GyroUnit::Auto,
            one_g_m_s2: 9.80665,
            scan_period_ms: 100.0,
            start_s: 0.0,
            duration_s: 0.0,
            allow_truncated: false,
        }
    }
}

impl Config {
    pub(crate) fn scan_period_ns(&self) -> i64 {
        (self.scan_period_ms * 1e6).round() as i64
    }

    pub(crate) fn imu_offset_ns(&self) -> i64 {
        (self.imu_offset_ms * 1e6).round() as i64
    }
}

impl StageConfig for Config {
    fn check(&self) -> Result<(), String> {
        match (&self.bag, &self.lidar, &self.imu) {
            (Some(_), None, None) | (None, Some(_), _) => {}
            (Some(_), _, _) => {
                return Err("bag excludes lidar and imu: give the one or the others".to_owned());
            }
            (None, None, _) => return Err("neither bag nor lidar is set: name the recording".to_owned()),
        }
        in_range("imu_rate_hz", self.imu_rate_hz, 1.0, 2000.0)?;
        // A device's clock counts from power-on, a host's from 1970: the offset may be decades.
        in_range("imu_offset_ms", self.imu_offset_ms, -4e12, 4e12)?;
        in_range("start_s", self.start_s, 0.0, 1e7)?;
        in_range("duration_s", self.duration_s, 0.0, 1e7)?;
        in_range("one_g_m_s2", self.one_g_m_s2, 9.7, 9.9)?;
        // The longest time since its frame's start that a point can carry is 167 ms.
        in_range("scan_period_ms", self.scan_period_ms, 10.0, 160.0)
    }
}

fn in_range(key: &str, value: f64, low: f64, high: f64) -> Result<(), String> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(format!("{key} = {value} is outside {low} to {high}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_must_be_named_and_only_one() {
        assert!(Config::default().check().unwrap_err().contains("name the recording"));
        let path = Some(PathBuf::from("walk"));
        assert!(Config { bag: path.clone(), lidar: path.clone(), ..Config::default() }.check().is_err());
        assert!(Config { imu: path.clone(), ..Config::default() }.check().is_err());
        assert!(Config { bag: path.clone(), ..Config::default() }.check().is_ok());
        assert!(Config { lidar: path.clone(), imu: path, ..Config::default() }.check().is_ok());
    }

    #[test]
    fn values_that_are_no_numbers_or_out_of_range_are_refused_by_name() {
        let bag = || Config { bag: Some("walk.bag".into()), ..Config::default() };
        assert!(Config { imu_rate_hz: f64::NAN, ..bag() }.check().unwrap_err().contains("imu_rate_hz"));
        assert!(Config { scan_period_ms: 200.0, ..bag() }.check().unwrap_err().contains("scan_period_ms"));
        assert!(Config { one_g_m_s2: 1.0, ..bag() }.check().unwrap_err().contains("one_g_m_s2"));
    }

    #[test]
    fn a_table_of_a_pipeline_file_is_read_and_a_wrong_key_refused() {
        let config: Config = toml::from_str("bag = \"a.bag\"\nimu_unit = \"m/s2\"").unwrap();
        assert_eq!(config.imu_unit, ImuUnit::MetresPerSecondSquared);
        assert_eq!(toml::from_str::<Config>(&toml::to_string(&config).unwrap()).unwrap(), config);
        assert!(toml::from_str::<Config>("bagg = \"a.bag\"").is_err());
    }
}

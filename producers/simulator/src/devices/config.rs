//! What the simulated devices can be told.

use std::path::PathBuf;

use evac_stage::StageConfig;
use serde::{Deserialize, Serialize};

use super::Fault;
use super::livox::LivoxConfig;
use crate::Config;

/// Configuration of the devices: the walk that they measure, and their connections.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DevicesConfig {
    /// The walk; it begins when the LiDAR is first told to measure.
    pub walk: Config,
    /// The LiDAR's address and protocol, and whether it has an IMU of its own: then no WT901C is plugged in.
    pub lidar: LivoxConfig,
    /// What goes wrong, and when: `["lost=0.01", "cable@20+5"]`; see `evac demo --help`.
    pub faults: Vec<Fault>,
    /// Path that names the WT901C's pseudo-terminal, as a serial port would be named.
    pub imu_port: PathBuf,
    /// How far the WT901C's clock is slow, parts per million.
    pub imu_clock_ppm: f64,
}

impl Default for DevicesConfig {
    fn default() -> Self {
        Self {
            walk: Config::default(),
            lidar: LivoxConfig::default(),
            faults: Vec::new(),
            imu_port: PathBuf::from("/tmp/evac-imu"),
            imu_clock_ppm: 30.0,
        }
    }
}

impl StageConfig for DevicesConfig {
    fn check(&self) -> Result<(), String> {
        self.walk.check().map_err(|cause| format!("walk: {cause}"))?;
        self.lidar.check().map_err(|cause| format!("lidar: {cause}"))?;
        if let Some(fault) = self.faults.iter().find(|fault| self.lidar.imu && fault.is_of_imu()) {
            return Err(format!("faults: {fault}: with lidar.imu = true there is no WT901C; leave it out"));
        }
        if self.walk.record.is_some() {
            return Err("walk.record: devices do not record; run the simulator itself with record".to_owned());
        }
        if self.walk.imu_rate_hz != 200 {
            return Err(format!(
                "walk.imu_rate_hz = {}: the WT901C measures 200 times a second; leave it out",
                self.walk.imu_rate_hz
            ));
        }
        evac_stage::check_range("imu_clock_ppm", self.imu_clock_ppm, -1000.0, 1000.0, "30 is a usual quartz")
    }
}

//! Where a LiDAR's scans go, and the samples of an IMU that sits inside it.

use evac_ports::{Bus, PortError};

use crate::{ImuOutput, RawScanOutput, StageOutput};

/// Scans, and the samples of the device's own IMU where they are asked for.
#[derive(Debug, Default)]
pub struct LidarOutput {
    /// Scans.
    pub scans: RawScanOutput,
    /// Samples of the device's own IMU.
    pub imu: ImuOutput,
}

impl LidarOutput {
    /// Services of a LiDAR whose IMU is not passed on.
    pub const SCANS_ONLY: &'static [&'static str] = RawScanOutput::SERVICES;

    /// Keeps only the newest scan and sample in memory and reuses their buffers, so that publishing does not allocate.
    pub fn newest_only() -> Self {
        Self { scans: RawScanOutput::newest_only(), imu: ImuOutput::newest_only() }
    }
}

impl StageOutput for LidarOutput {
    const SERVICES: &'static [&'static str] = &["lidar/scan", "imu/sample"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        Self::open_only(bus, epoch, Self::SERVICES)
    }

    fn open_only(bus: &Bus, epoch: u32, services: &[&str]) -> Result<Self, PortError> {
        let imu = match services.contains(&"imu/sample") {
            true => ImuOutput::samples_only(bus, epoch)?,
            false => ImuOutput::default(),
        };
        Ok(Self { scans: RawScanOutput::open(bus, epoch)?, imu })
    }
}

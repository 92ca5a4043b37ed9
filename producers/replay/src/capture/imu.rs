//! The IMU inside a Livox device (Tele-15, Horizon, Avia).

use std::path::Path;

use evac_formats::FormatError;
use evac_frames::ImuSample;
use evac_stage::{Counters, StageError};

use super::packets::{Kind, Packets};
use super::survey::Survey;
use crate::Config;
use crate::source::file;
use crate::streams::{ImuStream, imu_sample};

/// IMU packets of the device whose points are replayed, by their own stamps.
pub(super) struct CaptureImu {
    packets: Packets,
    one_g: f64,
    offset_ns: i64,
    /// Samples that were not whole or not finite.
    damaged: u64,
}

impl CaptureImu {
    pub(super) fn open(path: &Path, survey: &Survey, config: &Config) -> Result<Self, StageError> {
        let open = || Packets::of(path, survey.device, Kind::Imu, config.allow_truncated).map_err(file);
        if open()?.advance().map_err(file)?.is_none() {
            let text = format!(
                "{}: {} sends no IMU data (a Mid-40 has no IMU); give the WT901C's byte log as imu",
                path.display(),
                survey.device.ip
            );
            return Err(StageError::File(text));
        }
        tracing::info!("{}: the IMU is the LiDAR's own, in g", path.display());
        Ok(Self { packets: open()?, one_g: config.one_g_m_s2, offset_ns: config.imu_offset_ns(), damaged: 0 })
    }
}

impl ImuStream for CaptureImu {
    fn next_sample(&mut self) -> Result<Option<ImuSample>, FormatError> {
        while let Some(stamp) = self.packets.advance()? {
            let record = self.packets.datagram().and_then(|datagram| datagram.imu());
            let sample = record.and_then(|record| {
                let accel = record.accel_g.map(|value| f64::from(value) * self.one_g);
                imu_sample(stamp.saturating_add(self.offset_ns), record.gyro.map(f64::from), accel)
            });
            if sample.is_some() {
                return Ok(sample);
            }
            self.damaged += 1;
        }
        Ok(None)
    }

    /// The capture is the points' too, who count what is not of this device.
    fn counters(&self) -> Counters {
        let unused = self.packets.unused();
        Counters { late: unused.late, rejected: unused.stray + self.damaged, ..Counters::default() }
    }
}

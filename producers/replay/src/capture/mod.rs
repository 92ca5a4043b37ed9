//! Captures of a Livox device's packets (pcap, both protocols) and recordings of Livox Viewer (LVX, LVX2), with the device's
//! own IMU or a byte log.

mod clock;
mod datagram;
mod file;
mod imu;
mod packets;
mod scans;
mod survey;

use evac_stage::StageError;

use crate::Config;
use crate::imu_log::ImuLog;
use crate::source::file;
use crate::streams::{ImuStream, Recording};
use imu::CaptureImu;
use scans::CaptureScans;
pub(crate) use survey::Span;
use survey::Survey;

/// Opens `lidar` and `imu` of the configuration.
pub(crate) fn open(config: &Config) -> Result<Recording, StageError> {
    let Some(lidar) = &config.lidar else {
        return Err(StageError::Config("lidar is not set: name the capture".to_owned()));
    };
    let survey = Survey::read(lidar, config).map_err(file)?;
    let scans = CaptureScans::open(lidar, &survey, config).map_err(file)?;
    let imu: Box<dyn ImuStream> = match &config.imu {
        Some(log) => Box::new(ImuLog::open(log, &survey.span(), config).map_err(file)?),
        None => Box::new(CaptureImu::open(lidar, &survey, config)?),
    };
    Ok(Recording { scans: Box::new(scans), imu })
}

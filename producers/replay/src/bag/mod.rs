//! Bags of ROS 1 and ROS 2: Livox `CustomMsg` or `PointCloud2`, and `Imu`.

mod cloud;
mod exact;
mod imu;
mod scans;
mod topics;

use std::path::Path;

use evac_formats::FormatError;
use evac_formats::bag::Bag;
use evac_stage::StageError;

use crate::Config;
use crate::source::file;
use crate::streams::{Recording, seconds};
use imu::BagImu;
use scans::BagScans;
use topics::{choose_imu, choose_lidar};

/// Further apart than this the two sensors cannot have been on one clock.
const MAX_APART_S: f64 = 60.0;

/// Opens `bag` of the configuration.
pub(crate) fn open(config: &Config) -> Result<Recording, StageError> {
    let Some(path) = &config.bag else {
        return Err(StageError::Config("bag is not set: name the recording".to_owned()));
    };
    let bag = Bag::open(path, config.allow_truncated).map_err(file)?;
    for (part, offset) in bag.truncated() {
        tracing::warn!("{}: cut off at byte {offset}; what is before is used", part.display());
    }
    if config.lidar_topic.is_none()
        && config.imu_topic.is_none()
        && let Some(recording) = exact::open(&bag)?
    {
        return Ok(recording);
    }
    let lidar = choose_lidar(&bag, config.lidar_topic.as_deref())?;
    let imu = choose_imu(&bag, config.imu_topic.as_deref())?;
    let scans = BagScans::open(&bag, lidar, config).map_err(file)?;
    let imu = BagImu::open(&bag, imu, config)?;
    let apart = seconds(imu.first_ns().saturating_sub(scans.first_ns()));
    if apart.abs() > MAX_APART_S {
        let text = format!(
            "{}: the IMU begins {apart:.3} s after the LiDAR, so they were stamped by different clocks; \
             synchronise the LiDAR (PTP or GPS) when recording, or set imu_offset_ms near {:.0}",
            path.display(),
            -apart * 1e3
        );
        return Err(StageError::File(text));
    }
    Ok(Recording { scans: Box::new(scans), imu: Box::new(imu) })
}

/// A message at `offset` that is not what its type says.
fn bad_message(path: &Path, offset: u64, topic: &str, cause: &str) -> FormatError {
    let remedy = "the bag is damaged there: copy it again, or cut it with `rosbag filter` or `mcap filter`";
    FormatError::malformed(path, offset, format!("message on {topic}: {cause}"), remedy)
}

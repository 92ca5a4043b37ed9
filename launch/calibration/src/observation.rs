//! Orientations of the scans of a walk by the LiDAR alone.

use evac_experiments::{Pipeline, Settings, Walk};
use evac_geometry::nalgebra::{Matrix3, UnitQuaternion};
use evac_odometry::{Lio, LioConfig};
use evac_stage::StageError;

/// One scan's orientation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Observation {
    /// Middle of the scan by the LiDAR's clock, seconds since the walk's reference time.
    pub(crate) time_s: f64,
    /// `map_from_imu` rotation then, the IMU frame being that of the rig's file.
    pub(crate) map_from_imu: UnitQuaternion<f64>,
    /// Covariance of its right error, up to a factor, rad^2.
    pub(crate) covariance: Matrix3<f64>,
    /// Orientations of two maps are not to be compared.
    pub(crate) map: u64,
}

/// Runs deskewer and odometry over a walk. `told` is called with the number of each frame.
pub(crate) fn observe(
    walk: &Walk,
    lio: LioConfig,
    reference_ns: i64,
    mut told: impl FnMut(usize),
) -> Result<Vec<Observation>, StageError> {
    let mut pipeline = Pipeline::<Lio>::new(&Settings::default(), lio, &walk.rig)?;
    pipeline.odometry_mut().orient_scans();
    let stream = walk.imu();
    let mut observations = Vec::with_capacity(walk.frames.len());
    for (index, frame) in walk.frames.iter().enumerate() {
        pipeline.feed(frame, &stream)?;
        told(index + 1);
        observations.extend(pipeline.odometry().scan_orientation().map(|seen| Observation {
            time_s: seen.stamp_ns.saturating_sub(reference_ns) as f64 * 1e-9,
            map_from_imu: seen.map_from_imu,
            covariance: seen.covariance,
            map: seen.map,
        }));
    }
    Ok(observations)
}

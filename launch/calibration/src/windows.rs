//! Stretches of a walk within which orientations are compared.

use crate::gyro::Gyro;
use crate::observation::Observation;

/// Longest stretch, seconds: a turn of 90 degrees with what was seen before and after it. The gyroscope's noise (0.3 mrad
/// after 10 s) is still no larger than the LiDAR's. Of 3, 6 and 10 s the best and the most honest on the simulator's walks.
const LENGTH_S: f64 = 10.0;
/// Fewer scans say nothing beyond their own common orientation.
const MIN_SCANS: usize = 6;
/// Scans farther apart than this have others missing between them, seconds.
const MAX_STEP_S: f64 = 0.35;
/// Every clock offset that may be tried lies within this, seconds.
const MARGIN_S: f64 = 0.02;

/// Cuts the observations where the gyroscope was silent or held, where the map changed, and after ten seconds.
/// `time_offset_s` is what to add to an IMU stamp, as far as it is known.
pub(crate) fn windows<'a>(
    observations: &'a [Observation],
    gyro: &Gyro,
    time_offset_s: f64,
) -> Vec<&'a [Observation]> {
    let joined = |a: &Observation, b: &Observation| {
        let (from_s, to_s) = (a.time_s - time_offset_s, b.time_s - time_offset_s);
        a.map == b.map && b.time_s - a.time_s < MAX_STEP_S && gyro.covers(from_s - MARGIN_S, to_s + MARGIN_S)
    };
    let mut all = Vec::new();
    for stretch in observations.chunk_by(joined) {
        let (Some(first), Some(last)) = (stretch.first(), stretch.last()) else { continue };
        // Of equal length, so that none is a useless rest.
        let parts = ((last.time_s - first.time_s) / LENGTH_S).ceil().max(1.0) as usize;
        let size = stretch.len().div_ceil(parts).max(1);
        all.extend(stretch.chunks(size).filter(|window| window.len() >= MIN_SCANS));
    }
    all
}

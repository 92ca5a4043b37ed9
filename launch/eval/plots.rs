//! Compared trajectories as tracks of a picture.

use evac_evaluation::Pairs;
use evac_formats::tum::TumPose;
use evac_geometry::nalgebra::{Isometry3, Vector3};
use evac_picture::{Stroke, Track, TrackPoint};

/// The truth and each named estimate after first-pose alignment, counted in time and space from where the
/// comparison begins. The truth is shown where it is compared.
pub(crate) fn tracks<'a>(
    truth: &[TumPose],
    estimates: impl Iterator<Item = (&'a str, &'a Pairs)>,
) -> Vec<Track> {
    let estimates: Vec<_> = estimates.collect();
    let time =
        |pairs: &Pairs, stamp: Option<&i64>| stamp.map(|stamp| stamp.saturating_add(pairs.offset_ns()));
    let firsts = estimates.iter().filter_map(|(_, pairs)| time(pairs, pairs.stamps_ns().first()));
    let lasts = estimates.iter().filter_map(|(_, pairs)| time(pairs, pairs.stamps_ns().last()));
    let (Some(first), Some(last)) = (firsts.min(), lasts.max()) else { return Vec::new() };
    let compared: Vec<_> = truth.iter().filter(|pose| (first..=last).contains(&pose.stamp_ns)).collect();
    let origin = compared.first().map_or_else(Vector3::zeros, |pose| Vector3::from(pose.position));

    let seconds = |at: i64| at.saturating_sub(first) as f64 * 1e-9;
    let true_points = compared.iter().map(|pose| TrackPoint {
        time_s: seconds(pose.stamp_ns),
        position: (Vector3::from(pose.position) - origin).into(),
    });
    let truth = Track { name: "truth".to_owned(), stroke: Stroke::truth(), points: true_points.collect() };
    let estimated = estimates.iter().enumerate().map(|(i, (name, pairs))| {
        let alignment = pairs.first_pose_alignment();
        let point = |(stamp, pose): (&i64, &Isometry3<f64>)| TrackPoint {
            time_s: seconds(stamp.saturating_add(pairs.offset_ns())),
            position: ((alignment * pose).translation.vector - origin).into(),
        };
        let points = pairs.stamps_ns().iter().zip(pairs.estimate()).map(point).collect();
        Track { name: (*name).to_owned(), stroke: Stroke::nth(i), points }
    });
    std::iter::once(truth).chain(estimated).collect()
}

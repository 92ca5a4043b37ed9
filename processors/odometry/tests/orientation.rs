//! The orientation of scans by the LiDAR alone, in a box room whose truth is known.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic as the test may")]

mod common;

use common::Pipeline;
use common::room::{Room, glide};
use evac_geometry::nalgebra::{Rotation3, UnitQuaternion, Vector3};
use evac_stage::Rig;

#[test]
fn scans_that_are_oriented_turn_as_the_truth_does_and_the_odometry_does_not_notice() {
    let motion = glide(Vector3::new(1.0, -0.5, 0.1), 0.8, 5.0);
    let frames = Room::new(41).frames(8.0, &motion);
    let (mut plain, mut oriented) = (Pipeline::new(&Rig::default()), Pipeline::new(&Rig::default()));
    oriented.odometry.orient_scans();
    let mut seen = Vec::new();
    for frame in &frames {
        let poses = [frame.feed(&mut plain), frame.feed(&mut oriented)];
        assert_eq!(poses[0], poses[1]);
        assert!(plain.odometry.scan_orientation().is_none(), "nobody asked for it");
        if let Some(orientation) = oriented.odometry.scan_orientation() {
            let seconds = orientation.stamp_ns as f64 * 1e-9;
            assert!((seconds - frame.header.frame.end_ns as f64 * 1e-9 + 0.05).abs() < 1e-6);
            seen.push((*orientation, motion(seconds).rotation));
        }
    }
    assert!(seen.len() > 55, "{} of {} scans", seen.len(), frames.len());
    let (first, first_truth) = seen[0];
    let mut close = 0;
    for (orientation, truth) in &seen {
        let turned: UnitQuaternion<f64> = first.map_from_imu.inverse() * orientation.map_from_imu;
        let error = turned.angle_to(&(first_truth.inverse() * truth));
        let sigma = orientation.covariance.symmetric_eigenvalues().map(f64::sqrt);
        assert!(sigma.min() > 1e-5 && sigma.max() < 0.036, "{sigma}");
        // Where a scan does not show its orientation, it says so.
        assert!(error < 3.0 * sigma.max(), "{error} rad, {sigma}");
        close += usize::from(error.to_degrees() < 0.3);
        assert!(Rotation3::from(orientation.map_from_imu).matrix().iter().all(|x| x.is_finite()));
    }
    assert!(close * 10 > seen.len() * 8, "{close} of {} scans within 0.3 degrees", seen.len());
}

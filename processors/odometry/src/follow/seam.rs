//! The seam between two odometries' poses, closed without a step.
//!
//! Two odometries differ by some millimetres at any frame, and by centimetres where the LiDAR sees a blank wall only. The first pose of
//! the new one is therefore where the routed state and the IMU say that the rig has got to; what its own match says beyond that comes in
//! over the next [`CLOSES_NS`]. (A bumpless transfer, as controllers are swapped.)

use evac_frames::PoseFrame;
use evac_geometry::nalgebra::{Isometry3, Vector3};
use evac_geometry::{exp_so3, log_so3, map_from_imu, set_map_from_imu, set_map_from_lidar};

/// Time that the seam takes to close, nanoseconds.
const CLOSES_NS: i64 = 2_000_000_000;

/// What the published pose is off the instance's own, in the map frame, at the cut.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seam {
    way: Vector3<f64>,
    turn: Vector3<f64>,
    begun_ns: i64,
}

impl Seam {
    /// From the instance's own pose to where the stream goes on.
    pub(super) fn between(own: &Isometry3<f64>, stream: &Isometry3<f64>, begun_ns: i64) -> Self {
        Self {
            way: stream.translation.vector - own.translation.vector,
            turn: log_so3(&(stream.rotation * own.rotation.inverse())),
            begun_ns,
        }
    }

    /// Moves a pose of the instance by what is left of the seam; false when nothing is.
    pub(super) fn close(&self, pose: &mut PoseFrame, imu_from_lidar: &Isometry3<f64>) -> bool {
        let passed_ns = pose.frame.end_ns.saturating_sub(self.begun_ns);
        if !(0..CLOSES_NS).contains(&passed_ns) {
            return false;
        }
        let share = 1.0 - passed_ns as f64 / CLOSES_NS as f64;
        let (way, turn) = (self.way * share, self.turn * share);
        let mut moved = map_from_imu(pose);
        moved.translation.vector += way;
        moved.rotation = exp_so3(&turn) * moved.rotation;
        set_map_from_imu(pose, &moved);
        set_map_from_lidar(pose, &(moved * imu_from_lidar));
        // Either of the two may be the wrong one.
        for (axis, shift) in way.iter().chain(&turn).enumerate() {
            if let Some(variance) = pose.covariance.get_mut(axis * 7) {
                *variance += shift * shift;
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use evac_frames::FrameHeader;
    use evac_geometry::map_from_lidar;
    use evac_geometry::nalgebra::{Translation3, UnitQuaternion};

    use super::*;

    const RIG: [f64; 3] = [0.05, -0.02, 0.06];

    fn own(end_ns: i64) -> PoseFrame {
        let mut pose =
            PoseFrame { frame: FrameHeader { end_ns, ..FrameHeader::default() }, ..PoseFrame::default() };
        let place = Isometry3::from_parts(
            Translation3::new(3.0, -7.0, 0.4),
            UnitQuaternion::from_euler_angles(0.02, -0.03, 1.2),
        );
        set_map_from_imu(&mut pose, &place);
        set_map_from_lidar(&mut pose, &(place * Isometry3::translation(RIG[0], RIG[1], RIG[2])));
        pose
    }

    #[test]
    fn the_stream_goes_on_at_the_prediction_and_comes_to_the_new_instance_in_even_steps() {
        let rig = Isometry3::translation(RIG[0], RIG[1], RIG[2]);
        let place = map_from_imu(&own(0));
        let predicted =
            Translation3::new(0.03, 0.0, -0.01) * place * UnitQuaternion::from_euler_angles(0.0, 0.01, 0.0);
        let seam = Seam::between(&place, &predicted, 0);
        let at = |end_ns: i64| {
            let mut pose = own(end_ns);
            let goes_on = seam.close(&mut pose, &rig);
            (goes_on, pose)
        };
        let (_, first) = at(0);
        let error = map_from_imu(&first).inverse() * predicted;
        assert!(error.translation.vector.norm() < 1e-12 && error.rotation.angle() < 1e-9);
        let lidar = map_from_lidar(&first).inverse() * (predicted * rig);
        assert!(lidar.translation.vector.norm() < 1e-12);
        assert!(first.covariance[0] >= 0.03_f64.powi(2) - 1e-12);
        let mut before = first;
        for frame in 1..20 {
            let (goes_on, pose) = at(frame * 100_000_000);
            let step = Vector3::from(pose.imu_position) - Vector3::from(before.imu_position);
            assert!(goes_on && step.norm() < 0.032 / 20.0 + 1e-9, "{frame}: {step}");
            before = pose;
        }
        let (goes_on, last) = at(CLOSES_NS);
        assert!(!goes_on && last.imu_position == own(0).imu_position && last.covariance == own(0).covariance);
    }
}

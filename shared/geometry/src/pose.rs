//! Poses: exponential map, interpolation, and the poses inside a [`PoseFrame`].

use evac_frames::PoseFrame;
use nalgebra::{Isometry3, Matrix3, Quaternion, Translation3, UnitQuaternion, Vector3};

/// The matrix of the cross product: `skew(a) * b == a x b`.
pub fn skew(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// Rotation by the rotation vector `w` (radians).
pub fn exp_so3(w: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(*w)
}

/// Rotation vector (radians) of `rotation`.
pub fn log_so3(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    rotation.scaled_axis()
}

/// An isometry from a position in metres and a quaternion x, y, z, w, which is normalised; zero is no rotation.
pub fn isometry(position: [f64; 3], xyzw: [f64; 4]) -> Isometry3<f64> {
    let [x, y, z, w] = xyzw;
    let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-12).unwrap_or_default();
    Isometry3::from_parts(Translation3::from(Vector3::from(position)), rotation)
}

/// Pose of the LiDAR in the map frame.
pub fn map_from_lidar(pose: &PoseFrame) -> Isometry3<f64> {
    isometry(pose.position, pose.orientation)
}

/// Pose of the IMU in the map frame.
pub fn map_from_imu(pose: &PoseFrame) -> Isometry3<f64> {
    isometry(pose.imu_position, pose.imu_orientation)
}

/// Writes the LiDAR's pose into the frame.
pub fn set_map_from_lidar(pose: &mut PoseFrame, map_from_lidar: &Isometry3<f64>) {
    (pose.position, pose.orientation) = parts(map_from_lidar);
}

/// Writes the IMU's pose into the frame.
pub fn set_map_from_imu(pose: &mut PoseFrame, map_from_imu: &Isometry3<f64>) {
    (pose.imu_position, pose.imu_orientation) = parts(map_from_imu);
}

fn parts(pose: &Isometry3<f64>) -> ([f64; 3], [f64; 4]) {
    let q = pose.rotation.quaternion();
    (pose.translation.vector.into(), [q.i, q.j, q.k, q.w])
}

/// Pose between `a` (at `share` 0) and `b` (at 1): linear in position, shortest arc in rotation.
pub fn interpolate(a: &Isometry3<f64>, b: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    let arc = log_so3(&(a.rotation.inverse() * b.rotation));
    Isometry3::from_parts(
        Translation3::from(a.translation.vector.lerp(&b.translation.vector, share)),
        a.rotation * exp_so3(&(arc * share)),
    )
}

/// Poses with times, read at any time between the first and the last.
#[derive(Debug, Default, Clone)]
pub struct Interpolation {
    poses: Vec<(i64, Isometry3<f64>)>,
}

impl Interpolation {
    /// Sorts the poses by time; of two with the same time the first stays.
    pub fn new(mut poses: Vec<(i64, Isometry3<f64>)>) -> Self {
        poses.sort_by_key(|(time, _)| *time);
        poses.dedup_by_key(|(time, _)| *time);
        Self { poses }
    }

    /// The pose at `time_ns`; `None` outside the covered time.
    pub fn at(&self, time_ns: i64) -> Option<Isometry3<f64>> {
        let after = self.poses.partition_point(|(time, _)| *time < time_ns);
        let (t1, b) = self.poses.get(after)?;
        if *t1 == time_ns {
            return Some(*b);
        }
        let (t0, a) = self.poses.get(after.checked_sub(1)?)?;
        // Times are read from files: any two of them may lie further apart than 64 bits tell.
        Some(interpolate(a, b, time_ns.saturating_sub(*t0) as f64 / t1.saturating_sub(*t0) as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_way_between_two_poses_is_half_the_turn_and_half_the_way() {
        let a = isometry([0.0; 3], [0.0, 0.0, 0.0, 1.0]);
        let b = Isometry3::new(Vector3::new(2.0, 0.0, 0.0), Vector3::new(0.0, 0.0, 1.0));
        let track = Interpolation::new(vec![(100, b), (0, a)]);
        let middle = track.at(50).unwrap();
        assert!((middle.translation.vector - Vector3::new(1.0, 0.0, 0.0)).norm() < 1e-12);
        assert!((log_so3(&middle.rotation) - Vector3::new(0.0, 0.0, 0.5)).norm() < 1e-12);
        assert!(track.at(101).is_none() && track.at(-1).is_none());
    }

    #[test]
    fn exponential_and_logarithm_are_inverse_and_skew_is_the_cross_product() {
        let w = Vector3::new(0.3, -1.2, 0.8);
        assert!((log_so3(&exp_so3(&w)) - w).norm() < 1e-12);
        let b = Vector3::new(4.0, 5.0, -6.0);
        assert_eq!(skew(&w) * b, w.cross(&b));
    }

    #[test]
    fn a_pose_survives_its_frame() {
        let pose = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.1, 0.2, 0.3));
        let mut frame = PoseFrame::default();
        set_map_from_lidar(&mut frame, &pose);
        assert!((map_from_lidar(&frame).to_homogeneous() - pose.to_homogeneous()).norm() < 1e-12);
    }
}

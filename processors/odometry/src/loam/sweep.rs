//! Motion inside a frame: where a point is, given the pose at the frame's end.

use evac_geometry::nalgebra::{Isometry3, UnitQuaternion, Vector3};
use evac_geometry::{exp_so3, log_so3};

/// Where the LiDAR's points of a frame are: fixed (deskewed), or moving along with the pose that is sought.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sweep {
    /// `map_from_imu` at the end of the frame before.
    pub(crate) from: Isometry3<f64>,
    /// Time from there to this frame's start and end, nanoseconds.
    pub(crate) start_ns: i64,
    pub(crate) end_ns: i64,
    /// Points are already in the frame at the end.
    pub(crate) deskewed: bool,
}

/// Takes points to the map along a straight and even motion (paper, section III.B, linear interpolation).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Path {
    sweep: Sweep,
    to_position: Vector3<f64>,
    to_rotation: UnitQuaternion<f64>,
    arc: Vector3<f64>,
}

impl Path {
    pub(crate) fn new(sweep: &Sweep, (position, rotation): (Vector3<f64>, UnitQuaternion<f64>)) -> Self {
        let arc = log_so3(&(sweep.from.rotation.inverse() * rotation));
        Self { sweep: *sweep, to_position: position, to_rotation: rotation, arc }
    }

    /// Share of the way that is done when the point is measured, and the point's offset from the IMU and place in the map.
    pub(crate) fn place(&self, in_imu: &Vector3<f64>, offset_ns: i64) -> (f64, Vector3<f64>, Vector3<f64>) {
        if self.sweep.deskewed {
            let arm = self.to_rotation * in_imu;
            return (1.0, arm, self.to_position + arm);
        }
        let whole = self.sweep.end_ns.max(1) as f64;
        let share = ((self.sweep.start_ns + offset_ns) as f64 / whole).clamp(0.0, 1.0);
        let arm = self.sweep.from.rotation * (exp_so3(&(self.arc * share)) * in_imu);
        (share, arm, self.sweep.from.translation.vector.lerp(&self.to_position, share) + arm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_of_a_raw_scan_is_placed_where_the_lidar_was_and_one_of_a_deskewed_scan_at_the_end() {
        let end = Isometry3::new(Vector3::new(0.2, 0.0, 0.0), Vector3::z() * 0.1);
        let place = |deskewed| {
            let sweep = Sweep { from: Isometry3::identity(), start_ns: 0, end_ns: 100, deskewed };
            Path::new(&sweep, (end.translation.vector, end.rotation)).place(&Vector3::x(), 50)
        };
        let (share, arm, point) = place(false);
        let halfway = Vector3::new(0.05_f64.cos(), 0.05_f64.sin(), 0.0);
        assert!((share - 0.5).abs() < 1e-12 && (arm - halfway).norm() < 1e-12);
        assert!((point - halfway - Vector3::x() * 0.1).norm() < 1e-12);
        let (share, _, point) = place(true);
        assert!(
            share == 1.0
                && (point - (end * evac_geometry::nalgebra::Point3::new(1.0, 0.0, 0.0)).coords).norm()
                    < 1e-12
        );
    }
}

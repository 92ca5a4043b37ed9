//! Brings the points of a scan that came as measured to the frame's end (design section 5.3, paper Eq. 6).

use evac_geometry::exp_so3;
use evac_geometry::nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::propagation::TracePoint;
use super::state::State;

/// Moves points measured on the way of `trace` into the LiDAR frame at `end`.
#[derive(Debug)]
pub(crate) struct Deskew<'a> {
    trace: &'a [TracePoint],
    /// `lidar_from_map` at the end.
    lidar_from_map: Isometry3<f64>,
    imu_from_lidar: Isometry3<f64>,
    next: usize,
}

impl<'a> Deskew<'a> {
    pub(crate) fn new(trace: &'a [TracePoint], end: &State, imu_from_lidar: &Isometry3<f64>) -> Self {
        let lidar_from_map = (end.map_from_imu() * imu_from_lidar).inverse();
        Self { trace, lidar_from_map, imu_from_lidar: *imu_from_lidar, next: 0 }
    }

    /// The point at the frame's end; `stamp_ns` is its own time by the IMU's clock. Points mostly come in order of time.
    pub(crate) fn apply(&mut self, point: &Vector3<f64>, stamp_ns: i64) -> Vector3<f64> {
        while self.trace.get(self.next + 1).is_some_and(|after| after.stamp_ns <= stamp_ns) {
            self.next += 1;
        }
        while self.next > 0 && self.trace.get(self.next).is_some_and(|at| at.stamp_ns > stamp_ns) {
            self.next -= 1;
        }
        let Some(at) = self.trace.get(self.next) else { return *point };
        let h = (stamp_ns - at.stamp_ns) as f64 * 1e-9;
        let map_from_imu = Isometry3::from_parts(
            Translation3::from(at.state.position + at.state.velocity * h),
            at.state.rotation * exp_so3(&(at.rate * h)),
        );
        (self.lidar_from_map * (map_from_imu * (self.imu_from_lidar * Point3::from(*point)))).coords
    }
}

/// A motion: what the rig's points do.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Twist {
    /// Of the place where the IMU is at the scan's end, map frame, m/s.
    pub(crate) velocity: Vector3<f64>,
    /// Angular velocity in the IMU frame at the scan's end, rad/s.
    pub(crate) rate: Vector3<f64>,
}

/// Where the IMU was in the middle of a scan, whose points lie around that time: what a match says is true of then, and is the end's
/// only by way of the IMU.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Middle {
    /// `imu_at_middle_from_imu_at_end` rotation.
    pub(crate) from_end: UnitQuaternion<f64>,
    pub(crate) twist: Twist,
}

impl Middle {
    /// The motion at `stamp_ns` by the IMU's clock on the way of `trace` to `end`.
    pub(crate) fn of(trace: &[TracePoint], end: &State, stamp_ns: i64) -> Self {
        let after = trace.partition_point(|at| at.stamp_ns <= stamp_ns);
        let Some(at) = trace.get(after.saturating_sub(1)) else {
            let twist = Twist { velocity: end.velocity, rate: Vector3::zeros() };
            return Self { from_end: UnitQuaternion::identity(), twist };
        };
        let h = (stamp_ns - at.stamp_ns) as f64 * 1e-9;
        let rotation = at.state.rotation * exp_so3(&(at.rate * h));
        let from_end = rotation.inverse() * end.rotation;
        let rate = from_end.inverse() * at.rate;
        let way = end.position - (at.state.position + at.state.velocity * h);
        let velocity = at.state.velocity + (end.rotation * rate).cross(&way);
        Self { from_end, twist: Twist { velocity, rate } }
    }
}

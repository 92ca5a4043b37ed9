//! Brings the points of a scan that came as measured to the frame's end (design section 5.3, paper Eq. 6).

use evac_frames::Point;
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
        let Some(map_from_imu) = self.map_from_imu(stamp_ns) else { return *point };
        (self.lidar_from_map * (map_from_imu * (self.imu_from_lidar * Point3::from(*point)))).coords
    }

    /// The point as it was measured, from where it lies at the end of the frame that begins at `start_ns` by the IMU's clock.
    pub(crate) fn undo(&mut self, point: &Point, start_ns: i64) -> Point {
        let Some(map_from_imu) = self.map_from_imu(start_ns + point.offset_ns()) else { return *point };
        let at_end = Point3::new(f64::from(point.x), f64::from(point.y), f64::from(point.z));
        let in_map = self.lidar_from_map.inverse_transform_point(&at_end);
        let measured = (map_from_imu * self.imu_from_lidar).inverse_transform_point(&in_map);
        point.moved_to(measured.x as f32, measured.y as f32, measured.z as f32)
    }

    /// Where the IMU was at `stamp_ns` by its clock.
    fn map_from_imu(&mut self, stamp_ns: i64) -> Option<Isometry3<f64>> {
        while self.trace.get(self.next + 1).is_some_and(|after| after.stamp_ns <= stamp_ns) {
            self.next += 1;
        }
        while self.next > 0 && self.trace.get(self.next).is_some_and(|at| at.stamp_ns > stamp_ns) {
            self.next -= 1;
        }
        let at = self.trace.get(self.next)?;
        let h = (stamp_ns - at.stamp_ns) as f64 * 1e-9;
        Some(Isometry3::from_parts(
            Translation3::from(at.state.position + at.state.velocity * h),
            at.state.rotation * exp_so3(&(at.rate * h)),
        ))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_that_was_brought_to_the_end_and_back_lies_where_it_was_measured() {
        let rig = evac_geometry::imu_from_lidar([0.1, -0.2, 0.3], [10.0, -20.0, 30.0]);
        let state = |time: f64| State {
            rotation: exp_so3(&Vector3::new(0.3 * time, -0.2, time)),
            position: Vector3::new(time, 0.5 * time, 0.0),
            velocity: Vector3::new(1.0, 0.5, 0.0),
            ..State::at_origin()
        };
        let trace: Vec<_> = (0..20)
            .map(|k| TracePoint {
                stamp_ns: k * 5_000_000,
                state: state(k as f64 * 0.005),
                rate: Vector3::new(0.3, 0.0, 1.0),
            })
            .collect();
        let mut deskew = Deskew::new(&trace, &state(0.1), &rig);
        for offset_ns in [0, 12_345_670, 99_000_000] {
            let measured = Vector3::new(4.0, -1.0, 0.5);
            let at_end = deskew.apply(&measured, offset_ns);
            assert!(offset_ns > 90_000_000 || (at_end - measured).norm() > 0.1, "{at_end}");
            let point = Point::new(at_end.x as f32, at_end.y as f32, at_end.z as f32, offset_ns, 100);
            let back = deskew.undo(&point, 0);
            assert_eq!(back.packed, point.packed);
            let back = Vector3::new(f64::from(back.x), f64::from(back.y), f64::from(back.z));
            assert!((back - measured).norm() < 1e-6, "{back}");
        }
    }
}

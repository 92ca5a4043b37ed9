//! Back-propagation of points to the end of their frame (paper Eq. 6).

use evac_frames::Point;
use evac_geometry::ImuIntegrator;
use evac_geometry::nalgebra::Isometry3;

/// Grid of times on which Eq. 6's transform is computed exactly. Between them its 12 numbers are linear: at 300 deg/s
/// that bends a point 30 m away by 0.1 mm, at 1000 deg/s by 1.1 mm, and it does not depend on the IMU's rate.
const STEP_NS: i64 = 1_000_000;

/// Transforms from the LiDAR frame at a point's own time to the LiDAR frame at the end of the scan.
///
/// Looking up a time is one division by a constant; points need no order.
#[derive(Debug, Clone)]
pub(crate) struct BackProjection {
    /// One per step, each with the change to the next.
    steps: Vec<Step>,
    duration_ns: i64,
}

/// Rows of a 3x4 matrix at the step's start, and their change until the next step.
#[derive(Debug, Clone, Copy, Default)]
struct Step {
    rows: [[f32; 4]; 3],
    change: [[f32; 4]; 3],
}

impl BackProjection {
    /// Room for the longest frame whose points can carry their times.
    pub(crate) fn new() -> Self {
        Self { steps: Vec::with_capacity(steps_in(Point::MAX_OFFSET_NS)), duration_ns: 0 }
    }

    /// Tabulates `lidar_end_from_lidar_j = imu_from_lidar^-1 * imu_end_from_imu_j * imu_from_lidar` for the times j of a frame.
    pub(crate) fn tabulate(
        &mut self,
        motion: &ImuIntegrator,
        imu_from_lidar: &Isometry3<f64>,
        start_ns: i64,
        end_ns: i64,
    ) {
        self.duration_ns = (end_ns - start_ns).clamp(0, Point::MAX_OFFSET_NS);
        let lidar_end_from_world = (motion.pose_at(end_ns) * imu_from_lidar).inverse();
        let rows_at = |step: usize| {
            let world_from_imu = motion.pose_at(start_ns + step as i64 * STEP_NS);
            rows(&(lidar_end_from_world * world_from_imu * imu_from_lidar))
        };
        self.steps.clear();
        let mut from = rows_at(0);
        for step in 0..steps_in(self.duration_ns) {
            let to = rows_at(step + 1);
            let mut change = to;
            for (row, from) in change.iter_mut().flatten().zip(from.iter().flatten()) {
                *row -= from;
            }
            self.steps.push(Step {
                rows: from.map(|row| row.map(|v| v as f32)),
                change: change.map(|row| row.map(|v| v as f32)),
            });
            from = to;
        }
    }

    /// The point in the LiDAR frame at the end of the scan. A time after the end counts as the end.
    #[inline]
    pub(crate) fn apply(&self, point: &Point) -> Point {
        let offset_ns = point.offset_ns().min(self.duration_ns);
        let step = self.steps.get((offset_ns / STEP_NS) as usize).copied().unwrap_or_default();
        let share = (offset_ns % STEP_NS) as f32 * (1.0 / STEP_NS as f32);
        let row = |i: usize| {
            let (a, b) = (&step.rows[i], &step.change[i]);
            (a[0] + share * b[0]) * point.x
                + (a[1] + share * b[1]) * point.y
                + (a[2] + share * b[2]) * point.z
                + (a[3] + share * b[3])
        };
        point.moved_to(row(0), row(1), row(2))
    }
}

/// Steps whose starts cover the times from 0 to `duration_ns`, both included.
fn steps_in(duration_ns: i64) -> usize {
    (duration_ns / STEP_NS) as usize + 1
}

fn rows(transform: &Isometry3<f64>) -> [[f64; 4]; 3] {
    let (r, t) = (transform.rotation.to_rotation_matrix(), transform.translation.vector);
    [0, 1, 2].map(|i| [r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i]])
}

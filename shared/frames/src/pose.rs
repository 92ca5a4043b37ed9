//! What the odometry says.

use crate::layout::frame;
use crate::scan::FrameHeader;

/// State of the estimator, as [`PoseFrame::state`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum TrackingState {
    /// Waiting for a standstill to find gravity and biases; the pose is the identity.
    Initialising = 0,
    /// All directions are observed.
    Tracking = 1,
    /// At least one direction is not observed by the LiDAR and rests on the IMU.
    Degenerate = 2,
    /// The match with the map was lost; the pose is dead reckoning.
    Lost = 3,
}

impl TrackingState {
    /// The state behind a frame's number; `None` for a value of another build.
    pub fn of(number: u32) -> Option<Self> {
        [Self::Initialising, Self::Tracking, Self::Degenerate, Self::Lost]
            .into_iter()
            .find(|state| *state as u32 == number)
    }
}

frame! {
    /// Pose of one frame on `odometry/pose` and `truth/pose`.
    "evac.PoseFrame.v2", 640 bytes,
    pub struct PoseFrame {
        /// Sequence number and times of the scan; the pose holds at `end_ns`.
        pub frame: FrameHeader,
        /// Position of the LiDAR in the map frame, metres. The map's z is against gravity, its origin the first LiDAR pose.
        pub position: [f64; 3],
        /// Orientation of `pose_map_from_lidar` as quaternion x, y, z, w.
        pub orientation: [f64; 4],
        /// Position of the IMU in the map frame, metres.
        pub imu_position: [f64; 3],
        /// Orientation of `pose_map_from_imu` as quaternion x, y, z, w.
        pub imu_orientation: [f64; 4],
        /// Velocity of the IMU in the map frame, m/s.
        pub velocity: [f64; 3],
        /// Gyroscope bias, rad/s, IMU frame.
        pub gyro_bias: [f64; 3],
        /// Accelerometer bias, m/s^2, IMU frame.
        pub accel_bias: [f64; 3],
        /// Gravity in the map frame, m/s^2.
        pub gravity: [f64; 3],
        /// Covariance of the LiDAR pose, row-major 6x6 in the order x, y, z, rotation about x, y, z in the map frame
        /// (m^2, rad^2), as in `geometry_msgs/PoseWithCovariance`.
        pub covariance: [f64; 36],
        /// Directions in the map frame that the LiDAR did not observe, `degenerate` of them used.
        pub degenerate_axes: [[f64; 3]; 3],
        /// Time offset added to IMU stamps, nanoseconds.
        pub time_offset_ns: i64,
        /// Share of the selected points that the match used, 0 to 1.
        pub quality: f32,
        /// Number of translation directions not observed.
        pub degenerate: u32,
        /// See [`TrackingState`].
        pub state: u32,
        /// Standard deviation of the time offset, microseconds, as honest as the covariance; 0 where it is not estimated.
        pub time_offset_sigma_us: u32,
    }
}

impl PoseFrame {
    /// The estimator's state; `None` for a value of another build.
    pub fn tracking_state(&self) -> Option<TrackingState> {
        TrackingState::of(self.state)
    }
}

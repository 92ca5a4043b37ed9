//! What stages are called with. The run loop joins the streams; a stage only sees complete sets.

use evac_frames::{
    GridHeader, Health, ImuAttitude, ImuSample, MapHeader, Point, PoseFrame, Route, ScanHeader, Voxel,
};

/// A scan with the IMU data that covers it: input of the deskewer and of every odometry.
#[derive(Debug, Clone, Copy)]
pub struct ScanWithImu<'a> {
    /// Header of the scan.
    pub header: &'a ScanHeader,
    /// Its points, see [`Point`].
    pub points: &'a [Point],
    /// IMU samples in time order, from the last one at or before the previous frame's end (or this frame's start,
    /// whichever is earlier; on the first frame: all that came before) to the first one at or after this frame's end; with IMU stamps
    /// that run ahead of the LiDAR's by a known offset, to the first one at or after [`ScanHeader::imu_end_ns`].
    /// Consecutive calls overlap by the samples at the border.
    pub imu: &'a [ImuSample],
    /// Whether `imu` covers the frame to its end, or is all there is because the IMU's stream has ended. False when the IMU
    /// stopped without a word: the frame is then handed on after a time-out and counted as late.
    pub imu_covers: bool,
    /// Latest routed pose before this scan, where an odometry runs (always of the previous `seq` in lossless mode).
    pub prior: Option<&'a PoseFrame>,
}

/// A deskewed scan with the pose of the same `seq`: input of the mapper.
#[derive(Debug, Clone, Copy)]
pub struct ScanWithPose<'a> {
    /// Header of the scan.
    pub header: &'a ScanHeader,
    /// Its points in the LiDAR frame at the scan's end.
    pub points: &'a [Point],
    /// Pose at the scan's end.
    pub pose: &'a PoseFrame,
}

/// One message of the map: an update, or the snapshot that a late joiner starts from.
#[derive(Debug, Clone, Copy)]
pub struct MapMessage<'a> {
    /// Header; `map_flags::SNAPSHOT` says that the voxels are the whole map and replace what was known.
    pub header: &'a MapHeader,
    /// The changed voxels, or all.
    pub voxels: &'a [Voxel],
}

/// The map with the pose of the same `seq`: input of the grid exporter.
#[derive(Debug, Clone, Copy)]
pub struct PlanInput<'a> {
    /// The update (or snapshot).
    pub map: MapMessage<'a>,
    /// Pose at that scan's end. Where it did not come (counted as late, except for a snapshot): the map header's position,
    /// a quaternion of zeros and the state [`Lost`](evac_frames::TrackingState::Lost).
    pub pose: &'a PoseFrame,
}

/// Everything about one scan: input of the map saver.
#[derive(Debug, Clone, Copy)]
pub struct SinkInput<'a> {
    /// Header of the deskewed scan. Where it did not come (counted as late, except for a snapshot): the times of the map's
    /// header and no points.
    pub header: &'a ScanHeader,
    /// Its points in the LiDAR frame at the scan's end.
    pub points: &'a [Point],
    /// Pose at the scan's end, or what is known of it: see [`PlanInput::pose`].
    pub pose: &'a PoseFrame,
    /// The update (or snapshot) of the same `seq`.
    pub map: MapMessage<'a>,
    /// Truth at the scan's end, where a simulator runs.
    pub truth: Option<&'a PoseFrame>,
}

/// One message of any service, of the instance that is listened to: input of the recorder.
#[derive(Debug, Clone, Copy)]
pub enum Tapped<'a> {
    /// `lidar/scan`
    Scan(&'a ScanHeader, &'a [Point]),
    /// `imu/sample`
    Imu(&'a ImuSample),
    /// `imu/attitude`
    Attitude(&'a ImuAttitude),
    /// `scan/deskewed`
    Deskewed(&'a ScanHeader, &'a [Point]),
    /// `odometry/pose`
    Pose(&'a PoseFrame),
    /// `truth/pose`
    Truth(&'a PoseFrame),
    /// `map/update`
    Map(MapMessage<'a>),
    /// `grid/plan`; its cells are `i8`, given as bytes.
    Grid(&'a GridHeader, &'a [u8]),
    /// `health/status`, and the newest time of the sensors.
    Health(&'a Health, i64),
    /// `route`: which instance of a stage is listened to from here on; and the newest time of the sensors.
    Route(&'a Route, i64),
}

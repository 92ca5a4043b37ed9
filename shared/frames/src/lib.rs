//! The fixed layouts that cross shared memory between evac's processes, and nothing else.
//!
//! Every type is `#[repr(C)]` and [`bytemuck::Pod`], which forbids hidden padding: each bit is defined when it is
//! recorded, compared or read from another language. A layout is changed by giving it a new version in its
//! [`Layout::NAME`]; two builds that disagree refuse each other by [`layout_hash`].
//!
//! Conventions, everywhere: SI units, `f64` for state and `f32` for points, times as integer nanoseconds (`i64`),
//! quaternions in the order x, y, z, w (as in ROS), transforms named `pose_map_from_lidar` (maps LiDAR
//! coordinates to map coordinates).

mod attitude;
mod device;
mod health;
mod layout;
mod map;
mod pose;
mod route;
mod scan;
mod trace;

pub use attitude::{ImuAttitude, attitude_flags};
pub use device::{DeviceHealth, DeviceKind, NO_DEVICE_STATE, NO_TEMPERATURE};
pub use health::{Ack, Health, LatencySummary, NO_SEQ, OdometryHealth, StageState};
pub use layout::{Field, Layout, layout_hash};
pub use map::{GridHeader, MapHeader, Voxel, map_flags, voxel_flags};
pub use pose::{PoseFrame, TrackingState};
pub use route::{Route, route_flags};
pub use scan::{FrameHeader, ImuSample, MAX_TIME_OFFSET_NS, Point, ScanHeader, frame_flags, scan_flags};
pub use trace::Trace;

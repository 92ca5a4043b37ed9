//! Every service with its types and all its quality-of-service numbers; nothing else sets any.
//!
//! The creator of a service fixes its numbers for all others, so they are the same in every process. Safe overflow is
//! on everywhere: a stopped or dead subscriber never stalls a publisher; what it misses shows as a gap in `seq`.

use evac_frames::{
    Ack, GridHeader, Health, ImuAttitude, ImuSample, Layout, MapHeader, Point, PoseFrame, Route, ScanHeader,
    Trace, Voxel,
};

/// Quality of service of one service.
#[derive(Debug, Clone, Copy)]
pub struct Qos {
    /// Publishers at once: the routed one, one warming up, and dead ones that are not yet cleaned up.
    pub publishers: usize,
    /// Subscribers at once.
    pub subscribers: usize,
    /// Samples a subscriber may fall behind before the oldest is overwritten.
    pub buffer: usize,
    /// Samples a subscriber may hold by borrowing.
    pub borrowed: usize,
    /// Samples a late joiner gets.
    pub history: usize,
    /// Processes that may have it open.
    pub nodes: usize,
}

/// How much memory a publisher of slices reserves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SliceLen {
    /// Fixed at this many elements; a longer frame is refused. Pages are only touched when used.
    Fixed(usize),
    /// Starts here and grows by powers of two.
    Growing(usize),
}

/// A service of variable-length frames: a header and a slice.
pub trait FrameService {
    /// Name on the bus.
    const NAME: &'static str;
    /// Its numbers.
    const QOS: Qos;
    /// Memory a publisher reserves.
    const LEN: SliceLen;
    /// Header.
    type Header: Layout;
    /// Element of the slice.
    type Item: Layout;
}

/// A service of fixed-size records.
pub trait RecordService {
    /// Name on the bus.
    const NAME: &'static str;
    /// Its numbers.
    const QOS: Qos;
    /// The record.
    type Record: Layout;
}

/// 32 frames are 3.2 s of stall at 10 Hz; 48 borrowed let a stage hold 20 scans until their pose comes and another 20 of an
/// instance that is not routed yet. Every reader may have a standby, which also reads what its own stage writes.
const FRAMES: Qos = Qos { publishers: 4, subscribers: 14, buffer: 32, borrowed: 48, history: 16, nodes: 32 };

/// Points of the largest scan: 240,000 points/s (Horizon, Avia) over 150 ms, rounded up.
const MAX_POINTS: usize = 40_000;

/// Scans as the sensor gave them.
#[derive(Debug, Clone, Copy)]
pub struct LidarScan;
impl FrameService for LidarScan {
    const NAME: &'static str = "lidar/scan";
    const QOS: Qos = FRAMES;
    const LEN: SliceLen = SliceLen::Fixed(MAX_POINTS);
    type Header = ScanHeader;
    type Item = Point;
}

/// Scans without motion distortion.
#[derive(Debug, Clone, Copy)]
pub struct ScanDeskewed;
impl FrameService for ScanDeskewed {
    const NAME: &'static str = "scan/deskewed";
    const QOS: Qos = FRAMES;
    const LEN: SliceLen = SliceLen::Fixed(MAX_POINTS);
    type Header = ScanHeader;
    type Item = Point;
}

/// Changed voxels, one message a scan.
#[derive(Debug, Clone, Copy)]
pub struct MapUpdate;
impl FrameService for MapUpdate {
    const NAME: &'static str = "map/update";
    // No history: a late joiner asks for a snapshot instead of replaying a few updates out of many.
    const QOS: Qos = Qos { history: 0, ..FRAMES };
    const LEN: SliceLen = SliceLen::Growing(65_536);
    type Header = MapHeader;
    type Item = Voxel;
}

/// The whole map, on request.
#[derive(Debug, Clone, Copy)]
pub struct MapSnapshot;
impl FrameService for MapSnapshot {
    const NAME: &'static str = "map/snapshot";
    const QOS: Qos = Qos { buffer: 2, borrowed: 2, history: 0, ..FRAMES };
    const LEN: SliceLen = SliceLen::Growing(65_536);
    type Header = MapHeader;
    type Item = Voxel;
}

/// The flat map.
#[derive(Debug, Clone, Copy)]
pub struct GridPlan;
impl FrameService for GridPlan {
    const NAME: &'static str = "grid/plan";
    const QOS: Qos = Qos { buffer: 2, borrowed: 2, history: 1, ..FRAMES };
    const LEN: SliceLen = SliceLen::Growing(65_536);
    type Header = GridHeader;
    type Item = Cell;
}

/// One cell of the flat map on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct Cell(
    /// -1 unknown, 0 free, 100 occupied.
    pub i8,
);
impl Layout for Cell {
    const NAME: &'static str = "evac.Cell.v1";
    const FIELDS: &'static [evac_frames::Field] =
        &[evac_frames::Field { name: "value", offset: 0, size: 1, ty: "i8" }];
}

/// IMU samples.
#[derive(Debug, Clone, Copy)]
pub struct Imu;
impl RecordService for Imu {
    const NAME: &'static str = "imu/sample";
    // 4096 samples are 20 s at 200 Hz: a lossless replay paces itself on scans, so that all samples of a pause between two
    // scans come at once. History covers the 16 scans of a scan service's at 200 Hz, so that a stage that is started again has
    // both.
    const QOS: Qos = Qos { buffer: 4096, borrowed: 2, history: 512, ..FRAMES };
    type Record = ImuSample;
}

/// An IMU's own attitude and magnetometer.
#[derive(Debug, Clone, Copy)]
pub struct Attitude;
impl RecordService for Attitude {
    const NAME: &'static str = "imu/attitude";
    const QOS: Qos = Qos { buffer: 256, borrowed: 2, history: 0, ..FRAMES };
    type Record = ImuAttitude;
}

/// Poses of the routed odometry.
#[derive(Debug, Clone, Copy)]
pub struct OdometryPose;
impl RecordService for OdometryPose {
    const NAME: &'static str = "odometry/pose";
    const QOS: Qos = FRAMES;
    type Record = PoseFrame;
}

/// True poses of a simulated walk.
#[derive(Debug, Clone, Copy)]
pub struct TruthPose;
impl RecordService for TruthPose {
    const NAME: &'static str = "truth/pose";
    const QOS: Qos = FRAMES;
    type Record = PoseFrame;
}

/// Reports of all stages.
#[derive(Debug, Clone, Copy)]
pub struct HealthStatus;
impl RecordService for HealthStatus {
    const NAME: &'static str = "health/status";
    const QOS: Qos = Qos { publishers: 24, subscribers: 8, buffer: 8, borrowed: 2, history: 1, nodes: 32 };
    type Record = Health;
}

/// Words of the sinks that they are done with a frame.
#[derive(Debug, Clone, Copy)]
pub struct SinkAck;
impl RecordService for SinkAck {
    const NAME: &'static str = "sink/ack";
    const QOS: Qos = Qos { publishers: 12, subscribers: 14, buffer: 64, borrowed: 2, history: 1, nodes: 32 };
    type Record = Ack;
}

/// When frames passed the stages, for whoever wants to see it.
#[derive(Debug, Clone, Copy)]
pub struct FrameTrace;
impl RecordService for FrameTrace {
    const NAME: &'static str = "trace/frame";
    const QOS: Qos = Qos { publishers: 24, subscribers: 4, buffer: 256, borrowed: 2, history: 0, nodes: 32 };
    type Record = Trace;
}

/// The launcher's word on which instance of a stage is listened to. It says everything anew when a process joins.
#[derive(Debug, Clone, Copy)]
pub struct Routes;
impl RecordService for Routes {
    const NAME: &'static str = "route";
    const QOS: Qos = Qos { publishers: 2, subscribers: 48, buffer: 64, borrowed: 2, history: 0, nodes: 32 };
    type Record = Route;
}

/// Event by which a late joiner asks the mapper for a snapshot.
pub const SNAPSHOT_REQUEST: &str = "map/snapshot/request";

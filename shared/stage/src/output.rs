//! What stages write to: shared memory in a pipeline, plain vectors in tests and benches (`default()`).

use evac_frames::{
    FrameHeader, GridHeader, ImuAttitude, ImuSample, MapHeader, OdometryHealth, Point, PoseFrame, ScanHeader,
    Voxel,
};
use evac_ports::services::{
    Attitude, Cell, GridPlan, Imu, LidarScan, MapSnapshot, MapUpdate, OdometryPose, SNAPSHOT_REQUEST,
    ScanDeskewed, TruthPose,
};
use evac_ports::services::{FrameService, SliceLen};
use evac_ports::{Bus, FramePublisher, Listener, PortError, RecordPublisher, RequestReceiver, now_ns};

use crate::follow::{AckFollower, Followed, MapFollower, PoseFollower, Routed, ScanFollower};
use crate::{StageError, tracking};

/// An output that the run loop can connect to the bus.
pub trait StageOutput: Sized {
    /// Services it writes.
    const SERVICES: &'static [&'static str];
    /// Whether no other stage waits for what it writes: the stage then acknowledges each frame, and a lossless source
    /// paces itself on that.
    const IS_SINK: bool;

    /// Opens the services.
    ///
    /// # Errors
    /// [`PortError`].
    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError>;

    /// What wakes the run loop for requests that [`crate::Stage::serve`] answers.
    ///
    /// # Errors
    /// [`PortError`].
    fn listeners(&self, _bus: &Bus) -> Result<Vec<Listener>, PortError> {
        Ok(Vec::new())
    }

    /// Hands what is remembered to readers that have come since the last frame.
    ///
    /// # Errors
    /// [`PortError`].
    fn greet(&self) -> Result<(), PortError> {
        Ok(())
    }

    /// The first frame is `seq`: a producer that ended got as far.
    fn count_from(&mut self, _seq: u64) {}

    /// What this output goes on with, in a number: the epoch of the mapper that began the map.
    fn lineage(&self) -> u32 {
        0
    }

    /// Goes on with what another instance began; `None`: begins anew.
    fn go_on_with(&mut self, _lineage: Option<u32>) {}

    /// Opens those of [`Self::SERVICES`] that are named, where some may be left out; otherwise all.
    ///
    /// # Errors
    /// [`PortError`].
    fn open_only(bus: &Bus, epoch: u32, _services: &[&str]) -> Result<Self, PortError> {
        Self::open(bus, epoch)
    }

    /// How the odometry fares whose output this is, for the health report; nothing for other stages.
    fn odometry(&self) -> OdometryHealth {
        OdometryHealth::default()
    }
}

fn failed(cause: PortError) -> StageError {
    StageError::Output(cause.to_string())
}

/// Marks a header with its writer and the moment of its hand-over.
fn stamp(frame: &mut FrameHeader, epoch: u32) {
    frame.epoch = epoch;
    frame.sent_ns = now_ns();
}

/// Frames kept in memory instead of shared memory.
fn keep<H, T>(
    memory: &mut Vec<(H, Vec<T>)>,
    newest_only: bool,
    header: H,
    len: usize,
    fill: impl FnMut(usize) -> T,
) {
    match memory.last_mut() {
        Some((kept_header, kept)) if newest_only => {
            *kept_header = header;
            kept.clear();
            kept.extend((0..len).map(fill));
        }
        _ => memory.push((header, (0..len).map(fill).collect())),
    }
}

/// Where deskewed scans go.
#[derive(Debug, Default)]
pub struct ScanOutput {
    /// What was published, newest last, where no shared memory is connected.
    pub memory: Vec<(ScanHeader, Vec<Point>)>,
    newest_only: bool,
    port: Option<(FramePublisher<ScanDeskewed>, u32)>,
}

impl ScanOutput {
    /// Keeps only the newest scan in memory and reuses its buffer, so that publishing does not allocate.
    pub fn newest_only() -> Self {
        Self { newest_only: true, ..Self::default() }
    }

    /// Publishes a scan of `len` points; `fill(i)` is called once for each index in order and its result written
    /// straight into the loaned memory. `header.points` is set to `len`.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(
        &mut self,
        header: &ScanHeader,
        len: usize,
        fill: impl FnMut(usize) -> Point,
    ) -> Result<(), StageError> {
        let mut header = *header;
        header.points = len as u32;
        let Some((port, epoch)) = &self.port else {
            keep(&mut self.memory, self.newest_only, header, len, fill);
            return Ok(());
        };
        let finish = || {
            stamp(&mut header.frame, *epoch);
            header
        };
        port.publish(len, fill, finish).map_err(failed)
    }
}

impl StageOutput for ScanOutput {
    const SERVICES: &'static [&'static str] = &["scan/deskewed"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        Ok(Self { port: Some((FramePublisher::open(bus)?, epoch)), ..Self::default() })
    }

    fn greet(&self) -> Result<(), PortError> {
        self.port.as_ref().map_or(Ok(()), |(port, _)| port.greet())
    }
}

impl Followed for ScanOutput {
    type Follower = ScanFollower;

    fn repeat(&mut self, routed: Routed<'_, Self>) -> Result<(), StageError> {
        let points = routed.items();
        self.publish(routed.header(), points.len(), |i| points.get(i).copied().unwrap_or_default())
    }
}

/// Where a device's scans go.
#[derive(Debug, Default)]
pub struct RawScanOutput {
    /// What was published, newest last, where no shared memory is connected.
    pub memory: Vec<(ScanHeader, Vec<Point>)>,
    newest_only: bool,
    next_seq: u64,
    port: Option<(FramePublisher<LidarScan>, u32)>,
}

impl RawScanOutput {
    /// Most points of a scan; a longer one is refused.
    pub const MAX_POINTS: usize = match <LidarScan as FrameService>::LEN {
        SliceLen::Fixed(points) | SliceLen::Growing(points) => points,
    };

    /// Keeps only the newest scan in memory and reuses its buffer, so that publishing does not allocate.
    pub fn newest_only() -> Self {
        Self { newest_only: true, ..Self::default() }
    }

    /// Publishes a scan of `header.points` points; `fill(i)` is called once for each index in order and its result written
    /// straight into the loaned memory. Shots without return are counted. Gives the header with that, its number and the moment
    /// of its hand-over.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(
        &mut self,
        mut header: ScanHeader,
        mut fill: impl FnMut(usize) -> Point,
    ) -> Result<ScanHeader, StageError> {
        header.frame.seq = self.next_seq;
        self.next_seq += 1;
        let len = header.points as usize;
        let no_return = std::cell::Cell::new(0);
        let fill = |index| {
            let point = fill(index);
            no_return.set(no_return.get() + u32::from(!point.is_return()));
            point
        };
        let Some((port, epoch)) = &self.port else {
            keep(&mut self.memory, self.newest_only, header, len, fill);
            (header.no_return, header.frame.sent_ns) = (no_return.get(), now_ns());
            if let Some((kept, _)) = self.memory.last_mut() {
                *kept = header;
            }
            return Ok(header);
        };
        let finish = || {
            header.no_return = no_return.get();
            stamp(&mut header.frame, *epoch);
            header
        };
        port.publish(len, fill, finish).map_err(failed)?;
        Ok(header)
    }
}

impl StageOutput for RawScanOutput {
    const SERVICES: &'static [&'static str] = &["lidar/scan"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        Ok(Self { port: Some((FramePublisher::open(bus)?, epoch)), ..Self::default() })
    }

    fn greet(&self) -> Result<(), PortError> {
        self.port.as_ref().map_or(Ok(()), |(port, _)| port.greet())
    }

    fn count_from(&mut self, seq: u64) {
        self.next_seq = seq;
    }
}

/// Where the true poses of simulated devices go.
#[derive(Debug, Default)]
pub struct TruthOutput {
    /// What was published, newest last, where no shared memory is connected.
    pub memory: Vec<PoseFrame>,
    port: Option<(RecordPublisher<TruthPose>, u32)>,
}

impl TruthOutput {
    /// Publishes a pose.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(&mut self, pose: &PoseFrame) -> Result<(), StageError> {
        let mut pose = *pose;
        let Some((port, epoch)) = &self.port else {
            self.memory.push(pose);
            return Ok(());
        };
        stamp(&mut pose.frame, *epoch);
        port.publish(&pose).map_err(failed)
    }
}

impl StageOutput for TruthOutput {
    const SERVICES: &'static [&'static str] = &["truth/pose"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        Ok(Self { port: Some((RecordPublisher::open(bus)?, epoch)), ..Self::default() })
    }
}

/// Where a device's IMU samples go.
#[derive(Debug, Default)]
pub struct ImuOutput {
    /// What was published, newest last, where no shared memory is connected.
    pub memory: Vec<ImuSample>,
    /// Attitudes published, where no shared memory is connected.
    pub attitudes: Vec<ImuAttitude>,
    newest_only: bool,
    next_seq: u64,
    port: Option<ImuPort>,
}

#[derive(Debug)]
struct ImuPort {
    samples: RecordPublisher<Imu>,
    /// `None` for an IMU that has none.
    attitudes: Option<RecordPublisher<Attitude>>,
    epoch: u32,
}

impl ImuOutput {
    /// Keeps only the newest sample and attitude in memory, so that publishing does not allocate.
    pub fn newest_only() -> Self {
        let (memory, attitudes) = (Vec::with_capacity(1), Vec::with_capacity(1));
        Self { newest_only: true, memory, attitudes, ..Self::default() }
    }

    /// Opens the service of samples, for an IMU that knows no attitude.
    pub(crate) fn samples_only(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        let port = ImuPort { samples: RecordPublisher::open(bus)?, attitudes: None, epoch };
        Ok(Self { port: Some(port), ..Self::default() })
    }

    /// Publishes a sample; gives it with its number and the moment of its hand-over.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(&mut self, sample: &ImuSample) -> Result<ImuSample, StageError> {
        let mut sample = ImuSample { seq: self.next_seq, sent_ns: now_ns(), ..*sample };
        self.next_seq += 1;
        match &self.port {
            Some(port) => {
                sample.epoch = port.epoch;
                port.samples.publish(&sample).map_err(failed)?;
            }
            None => {
                if self.newest_only {
                    self.memory.clear();
                }
                self.memory.push(sample);
            }
        }
        Ok(sample)
    }

    /// Publishes what the IMU itself makes of the newest sample.
    ///
    /// # Errors
    /// As [`Self::publish`].
    pub fn publish_attitude(&mut self, attitude: &ImuAttitude) -> Result<(), StageError> {
        let seq = self.next_seq.saturating_sub(1);
        let attitude = ImuAttitude { seq, sent_ns: now_ns(), ..*attitude };
        let Some(port) = &self.port else {
            if self.newest_only {
                self.attitudes.clear();
            }
            self.attitudes.push(attitude);
            return Ok(());
        };
        let attitude = ImuAttitude { epoch: port.epoch, ..attitude };
        port.attitudes.as_ref().map_or(Ok(()), |attitudes| attitudes.publish(&attitude)).map_err(failed)
    }
}

impl StageOutput for ImuOutput {
    const SERVICES: &'static [&'static str] = &["imu/sample", "imu/attitude"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        let attitudes = Some(RecordPublisher::open(bus)?);
        let port = ImuPort { samples: RecordPublisher::open(bus)?, attitudes, epoch };
        Ok(Self { port: Some(port), ..Self::default() })
    }

    fn count_from(&mut self, seq: u64) {
        self.next_seq = seq;
    }

    fn greet(&self) -> Result<(), PortError> {
        self.port.as_ref().map_or(Ok(()), |port| port.samples.greet())
    }
}

/// Where poses go.
#[derive(Debug, Default)]
pub struct PoseOutput {
    /// What was published, newest last, where no shared memory is connected.
    pub memory: Vec<PoseFrame>,
    newest_only: bool,
    odometry: OdometryHealth,
    port: Option<(RecordPublisher<OdometryPose>, u32)>,
}

impl PoseOutput {
    /// Keeps only the newest pose in memory, so that publishing does not allocate.
    pub fn newest_only() -> Self {
        Self { newest_only: true, memory: Vec::with_capacity(1), ..Self::default() }
    }

    /// Publishes a pose.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(&mut self, pose: &PoseFrame) -> Result<(), StageError> {
        tracking::count(&mut self.odometry, pose);
        let Some((port, epoch)) = &self.port else {
            if self.newest_only {
                self.memory.clear();
            }
            self.memory.push(*pose);
            return Ok(());
        };
        let mut pose = *pose;
        stamp(&mut pose.frame, *epoch);
        port.publish(&pose).map_err(failed)
    }
}

impl StageOutput for PoseOutput {
    const SERVICES: &'static [&'static str] = &["odometry/pose"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        Ok(Self { port: Some((RecordPublisher::open(bus)?, epoch)), ..Self::default() })
    }

    fn odometry(&self) -> OdometryHealth {
        self.odometry
    }

    fn greet(&self) -> Result<(), PortError> {
        self.port.as_ref().map_or(Ok(()), |(port, _)| port.greet())
    }
}

impl Followed for PoseOutput {
    type Follower = PoseFollower;

    fn note(&mut self, routed: &Routed<'_, Self>) {
        tracking::count(&mut self.odometry, routed);
    }

    fn repeat(&mut self, routed: Routed<'_, Self>) -> Result<(), StageError> {
        self.publish(routed)
    }
}

/// Where map updates and snapshots go.
#[derive(Debug, Default)]
pub struct MapOutput {
    /// Updates published, newest last, where no shared memory is connected.
    pub memory: Vec<(MapHeader, Vec<Voxel>)>,
    /// Snapshots published, newest last, where no shared memory is connected.
    pub snapshots: Vec<(MapHeader, Vec<Voxel>)>,
    /// Lets a test ask for a snapshot where no shared memory is connected.
    pub request_snapshot: bool,
    newest_only: bool,
    /// Epoch of the mapper that began the map, where it was another.
    map_epoch: Option<u32>,
    port: Option<MapPort>,
}

#[derive(Debug)]
struct MapPort {
    updates: FramePublisher<MapUpdate>,
    snapshots: FramePublisher<MapSnapshot>,
    requests: RequestReceiver,
    epoch: u32,
}

impl MapOutput {
    /// Keeps only the newest update in memory and reuses its buffer, so that publishing does not allocate.
    pub fn newest_only() -> Self {
        Self { newest_only: true, ..Self::default() }
    }

    /// Publishes an update; `header.voxels` is set to `len`, `fill(i)` is called once for each index in order.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(
        &mut self,
        header: &MapHeader,
        len: usize,
        fill: impl FnMut(usize) -> Voxel,
    ) -> Result<(), StageError> {
        let mut header = *header;
        header.voxels = len as u32;
        header.map_epoch = self.lineage();
        let Some(port) = &self.port else {
            keep(&mut self.memory, self.newest_only, header, len, fill);
            return Ok(());
        };
        let finish = || {
            stamp(&mut header.frame, port.epoch);
            header
        };
        port.updates.publish(len, fill, finish).map_err(failed)
    }

    /// Whether a late joiner has asked for a snapshot since the last call.
    pub fn snapshot_requested(&mut self) -> bool {
        match &self.port {
            Some(port) => port.requests.take(),
            None => std::mem::take(&mut self.request_snapshot),
        }
    }

    /// Publishes the whole map for late joiners; as [`Self::publish`], with `map_flags::SNAPSHOT` in the header.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish_snapshot(
        &mut self,
        header: &MapHeader,
        len: usize,
        fill: impl FnMut(usize) -> Voxel,
    ) -> Result<(), StageError> {
        let mut header = *header;
        header.voxels = len as u32;
        header.map_epoch = self.lineage();
        let Some(port) = &self.port else {
            keep(&mut self.snapshots, self.newest_only, header, len, fill);
            return Ok(());
        };
        let finish = || {
            stamp(&mut header.frame, port.epoch);
            header
        };
        port.snapshots.publish(len, fill, finish).map_err(failed)
    }
}

impl StageOutput for MapOutput {
    const SERVICES: &'static [&'static str] = &["map/update", "map/snapshot"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        let port = MapPort {
            updates: FramePublisher::open(bus)?,
            snapshots: FramePublisher::open(bus)?,
            requests: RequestReceiver::open(bus, SNAPSHOT_REQUEST)?,
            epoch,
        };
        Ok(Self { port: Some(port), ..Self::default() })
    }

    fn listeners(&self, bus: &Bus) -> Result<Vec<Listener>, PortError> {
        Ok(vec![RequestReceiver::listener(bus, SNAPSHOT_REQUEST)?])
    }

    fn lineage(&self) -> u32 {
        self.map_epoch.unwrap_or(self.port.as_ref().map_or(0, |port| port.epoch))
    }

    fn go_on_with(&mut self, lineage: Option<u32>) {
        self.map_epoch = lineage;
    }
}

impl Followed for MapOutput {
    type Follower = MapFollower;

    fn note(&mut self, routed: &Routed<'_, Self>) {
        self.map_epoch = Some(routed.header.map_epoch);
    }

    fn repeat(&mut self, routed: Routed<'_, Self>) -> Result<(), StageError> {
        let voxels = routed.voxels;
        self.publish(routed.header, voxels.len(), |i| voxels.get(i).copied().unwrap_or_default())
    }
}

/// Where flat maps go.
#[derive(Debug, Default)]
pub struct GridOutput {
    /// What was published, newest last, where no shared memory is connected.
    pub memory: Vec<(GridHeader, Vec<i8>)>,
    port: Option<(FramePublisher<GridPlan>, u32)>,
}

impl GridOutput {
    /// Publishes a plan of `header.width * header.height` cells; `fill(i)` is called once for each index in order.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(
        &mut self,
        header: &GridHeader,
        mut fill: impl FnMut(usize) -> i8,
    ) -> Result<(), StageError> {
        let mut header = *header;
        let len = header.width as usize * header.height as usize;
        let Some((port, epoch)) = &self.port else {
            keep(&mut self.memory, false, header, len, fill);
            return Ok(());
        };
        let finish = || {
            stamp(&mut header.frame, *epoch);
            header
        };
        port.publish(len, |i| Cell(fill(i)), finish).map_err(failed)
    }
}

impl StageOutput for GridOutput {
    const SERVICES: &'static [&'static str] = &["grid/plan"];
    const IS_SINK: bool = true;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        Ok(Self { port: Some((FramePublisher::open(bus)?, epoch)), ..Self::default() })
    }
}

impl Followed for GridOutput {
    type Follower = AckFollower;

    fn repeat(&mut self, _routed: Routed<'_, Self>) -> Result<(), StageError> {
        Ok(())
    }
}

/// For sinks that write files only.
#[derive(Debug, Default)]
pub struct NoOutput;

impl StageOutput for NoOutput {
    const SERVICES: &'static [&'static str] = &[];
    const IS_SINK: bool = true;

    fn open(_bus: &Bus, _epoch: u32) -> Result<Self, PortError> {
        Ok(Self)
    }
}

impl Followed for NoOutput {
    type Follower = AckFollower;

    fn repeat(&mut self, _routed: Routed<'_, Self>) -> Result<(), StageError> {
        Ok(())
    }
}

//! Everything that is said on the services, message by message.

use std::collections::VecDeque;

use evac_frames::{FrameHeader, Health, ImuSample, Route, frame_flags};
use evac_ports::services::{
    FrameService, GridPlan, HealthStatus, Imu, LidarScan, MapUpdate, OdometryPose, RecordService,
    ScanDeskewed, TruthPose,
};
use evac_ports::{Bus, FrameSample, FrameSubscriber, Listener, PortError, RecordSubscriber};

use super::seq::SeqTracker;
use super::{Join, JoinOptions, MAX_HELD};
use crate::{InputCounters, MapMessage, Reporter, Tapped};

/// Records taken in at once; the rest stays in shared memory.
const MAX_RECORDS: usize = 256;

/// Listens to all services. Nothing is joined: what has come is handed on one by one, oldest first by the time of the
/// sensors, each frame borrowed from shared memory.
///
/// A frame is done with when every service that a stage writes has passed it on. The stream has ended when all of them
/// say so: the last deskewed scan, pose and map update come after the last scan.
pub struct TapJoin {
    scans: FrameTap<LidarScan>,
    deskewed: FrameTap<ScanDeskewed>,
    map: FrameTap<MapUpdate>,
    grid: FrameTap<GridPlan>,
    imu: RecordTap<Imu>,
    poses: RecordTap<OdometryPose>,
    truth: RecordTap<TruthPose>,
    health: RecordTap<HealthStatus>,
    /// The newest time of a sensor; a health report has none of its own.
    now_ns: i64,
    /// The next frame that is not done with.
    next: u64,
}

impl Join for TapJoin {
    const SERVICES: &'static [&'static str] = &[
        "lidar/scan",
        "imu/sample",
        "scan/deskewed",
        "odometry/pose",
        "truth/pose",
        "map/update",
        "grid/plan",
        "health/status",
    ];
    type Frame<'a> = Tapped<'a>;

    fn open(bus: &Bus, _options: JoinOptions) -> Result<(Self, Vec<Listener>), PortError> {
        let mut listeners = Vec::new();
        let join = Self {
            scans: FrameTap::open(bus, MAX_HELD, &mut listeners)?,
            deskewed: FrameTap::open(bus, MAX_HELD, &mut listeners)?,
            map: FrameTap::open(bus, MAX_HELD, &mut listeners)?,
            // A subscriber may borrow two.
            grid: FrameTap::open(bus, 1, &mut listeners)?,
            imu: RecordTap::open(bus, &mut listeners)?,
            poses: RecordTap::open(bus, &mut listeners)?,
            truth: RecordTap::open(bus, &mut listeners)?,
            health: RecordTap::open(bus, &mut listeners)?,
            now_ns: 0,
            next: 0,
        };
        Ok((join, listeners))
    }

    /// What an instance says is recorded whether it is listened to or not; its epoch says which it is.
    fn route(&mut self, _route: &Route) {}

    /// Nothing is held back: a recorder is not swapped, it is ended and another begun.
    fn limit(&mut self, _seq: u64) {}

    fn front(&self) -> Option<u64> {
        None
    }

    fn take_in(&mut self, reporter: &mut Reporter) -> Result<(), PortError> {
        self.scans.take_in(reporter, |header| &header.frame)?;
        self.deskewed.take_in(reporter, |header| &header.frame)?;
        self.map.take_in(reporter, |header| &header.frame)?;
        self.grid.take_in(reporter, |header| &header.frame)?;
        self.imu.take_in(reporter, |sample| sample.sent_ns)?;
        self.poses.take_in(reporter, |pose| pose.frame.sent_ns)?;
        self.truth.take_in(reporter, |pose| pose.frame.sent_ns)?;
        self.health.take_in(reporter, |health| health.reported_ns)
    }

    fn next<R>(
        &mut self,
        reporter: &mut Reporter,
        process: impl FnOnce(Self::Frame<'_>, &FrameHeader, &mut Reporter) -> R,
    ) -> Option<R> {
        let times = [
            self.imu.queue.front().map(|sample| sample.stamp_ns),
            self.scans.queue.front().map(|scan| scan.header().frame.end_ns),
            self.truth.queue.front().map(|pose| pose.frame.end_ns),
            self.deskewed.queue.front().map(|scan| scan.header().frame.end_ns),
            self.poses.queue.front().map(|pose| pose.frame.end_ns),
            self.map.queue.front().map(|update| update.header().frame.end_ns),
            self.grid.queue.front().map(|grid| grid.header().frame.end_ns),
        ];
        let oldest = times.into_iter().enumerate().filter_map(|(at, time)| Some((time?, at))).min();
        if let Some((time_ns, _)) = oldest {
            self.now_ns = time_ns;
        }
        match oldest.map(|(_, at)| at) {
            Some(0) => {
                let sample = self.imu.queue.pop_front()?;
                let frame = self.imu.pass(&frame_of(&sample), |input, gap| input.imu_lost += gap, reporter);
                Some(process(Tapped::Imu(&sample), &frame, reporter))
            }
            Some(1) => {
                let scan = self.scans.queue.pop_front()?;
                let frame = self.scans.pass(&scan.header().frame, reporter);
                Some(process(Tapped::Scan(scan.header(), scan.items()), &frame, reporter))
            }
            Some(2) => {
                let pose = self.truth.queue.pop_front()?;
                let frame = self.truth.pass(&pose.frame, |input, gap| input.lost += gap, reporter);
                Some(process(Tapped::Truth(&pose), &frame, reporter))
            }
            Some(3) => {
                let scan = self.deskewed.queue.pop_front()?;
                let frame = self.deskewed.pass(&scan.header().frame, reporter);
                Some(process(Tapped::Deskewed(scan.header(), scan.items()), &frame, reporter))
            }
            Some(4) => {
                let pose = self.poses.queue.pop_front()?;
                let frame = self.poses.pass(&pose.frame, |input, gap| input.lost += gap, reporter);
                Some(process(Tapped::Pose(&pose), &frame, reporter))
            }
            Some(5) => {
                let update = self.map.queue.pop_front()?;
                let frame = self.map.pass(&update.header().frame, reporter);
                let message = MapMessage { header: update.header(), voxels: update.items() };
                Some(process(Tapped::Map(message), &frame, reporter))
            }
            Some(_) => {
                let grid = self.grid.queue.pop_front()?;
                // Plans come now and then: their numbers have gaps that are none.
                let frame = grid.header().frame;
                Some(process(Tapped::Grid(grid.header(), cells(&grid)), &frame, reporter))
            }
            None => {
                let health = self.health.queue.pop_front()?;
                let frame = frame_of_health(&health, self.now_ns);
                Some(process(Tapped::Health(&health, self.now_ns), &frame, reporter))
            }
        }
    }

    fn done(&mut self, _frame: &FrameHeader) -> Option<FrameHeader> {
        let frames =
            [self.scans.progress(), self.deskewed.progress(), self.map.progress(), self.poses.progress()];
        // Which stages run is known when the first scan comes: they are started before it.
        self.scans.seq.passed()?;
        let next = frames.iter().flatten().map(|progress| progress.next).min()?;
        let ended = frames.iter().flatten().chain(&self.imu.progress()).all(|progress| progress.ended);
        if next <= self.next && !ended {
            return None;
        }
        self.next = next;
        let flags = if ended { frame_flags::END_OF_STREAM } else { 0 };
        Some(FrameHeader { seq: next.checked_sub(1)?, flags, ..FrameHeader::default() })
    }
}

/// How far a service that a stage writes has come.
#[derive(Debug, Clone, Copy)]
struct Progress {
    /// The first frame that has not come.
    next: u64,
    ended: bool,
}

/// One service of frames.
struct FrameTap<S: FrameService> {
    port: FrameSubscriber<S>,
    queue: VecDeque<FrameSample<S>>,
    most: usize,
    seq: SeqTracker,
    ended: bool,
}

impl<S: FrameService> FrameTap<S> {
    fn open(bus: &Bus, most: usize, listeners: &mut Vec<Listener>) -> Result<Self, PortError> {
        let (port, listener) = FrameSubscriber::open(bus)?;
        listeners.push(listener);
        let queue = VecDeque::with_capacity(most);
        Ok(Self { port, queue, most, seq: SeqTracker::default(), ended: false })
    }

    fn take_in(
        &mut self,
        reporter: &mut Reporter,
        frame: impl Fn(&S::Header) -> &FrameHeader,
    ) -> Result<(), PortError> {
        while self.queue.len() < self.most {
            let Some(sample) = self.port.receive()? else { break };
            reporter.received(frame(sample.header()).sent_ns);
            self.queue.push_back(sample);
        }
        Ok(())
    }

    fn pass(&mut self, frame: &FrameHeader, reporter: &mut Reporter) -> FrameHeader {
        reporter.input.lost += self.seq.gap(frame.seq).unwrap_or_default();
        self.ended |= frame.flags & frame_flags::END_OF_STREAM != 0;
        *frame
    }

    fn progress(&self) -> Option<Progress> {
        let next = self.seq.passed();
        let is_written = next.is_some() || self.port.has_publisher();
        is_written.then(|| Progress { next: next.unwrap_or_default(), ended: self.ended })
    }
}

/// One service of records.
struct RecordTap<S: RecordService> {
    port: RecordSubscriber<S>,
    queue: VecDeque<S::Record>,
    seq: SeqTracker,
    ended: bool,
}

impl<S: RecordService> RecordTap<S> {
    fn open(bus: &Bus, listeners: &mut Vec<Listener>) -> Result<Self, PortError> {
        let (port, listener) = RecordSubscriber::open(bus)?;
        listeners.push(listener);
        let queue = VecDeque::with_capacity(MAX_RECORDS);
        Ok(Self { port, queue, seq: SeqTracker::default(), ended: false })
    }

    fn take_in(
        &mut self,
        reporter: &mut Reporter,
        sent_ns: impl Fn(&S::Record) -> i64,
    ) -> Result<(), PortError> {
        while self.queue.len() < MAX_RECORDS {
            let Some(record) = self.port.receive()? else { break };
            reporter.received(sent_ns(&record));
            self.queue.push_back(record);
        }
        Ok(())
    }

    fn pass(
        &mut self,
        frame: &FrameHeader,
        lost: impl FnOnce(&mut InputCounters, u64),
        reporter: &mut Reporter,
    ) -> FrameHeader {
        lost(&mut reporter.input, self.seq.gap(frame.seq).unwrap_or_default());
        self.ended |= frame.flags & frame_flags::END_OF_STREAM != 0;
        *frame
    }

    fn progress(&self) -> Option<Progress> {
        let next = self.seq.passed();
        let is_written = next.is_some() || self.port.has_publisher();
        is_written.then(|| Progress { next: next.unwrap_or_default(), ended: self.ended })
    }
}

/// An IMU sample as it is counted.
fn frame_of(sample: &ImuSample) -> FrameHeader {
    let ImuSample { seq, stamp_ns, arrival_ns, sent_ns, epoch, flags, .. } = *sample;
    FrameHeader { seq, start_ns: stamp_ns, end_ns: stamp_ns, arrival_ns, sent_ns, epoch, flags }
}

/// A report as it is counted.
fn frame_of_health(health: &Health, now_ns: i64) -> FrameHeader {
    let (arrival_ns, sent_ns) = (health.reported_ns, health.reported_ns);
    FrameHeader { start_ns: now_ns, end_ns: now_ns, arrival_ns, sent_ns, ..FrameHeader::default() }
}

fn cells(grid: &FrameSample<GridPlan>) -> &[u8] {
    bytemuck::cast_slice(grid.items())
}

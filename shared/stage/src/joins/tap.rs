//! Everything that is said on the services, message by message.

use std::collections::VecDeque;

use evac_frames::{FrameHeader, ImuAttitude, ImuSample, Route, frame_flags};
use evac_ports::services::{
    Attitude, FrameService, GridPlan, HealthStatus, Imu, LidarScan, MapUpdate, OdometryPose, RecordService,
    ScanDeskewed, TruthPose,
};
use evac_ports::{Bus, FrameSample, FrameSubscriber, Listener, PortError, RecordSubscriber, now_ns};

use super::tap_port::Tap;
use super::{Join, JoinOptions, MAX_HELD};
use crate::{MapMessage, Reporter, Tapped};

/// Records taken in at once; the rest stays in shared memory.
const MAX_RECORDS: usize = 256;
/// Words of the launcher for which there is room from the start; there are a few a swap.
const MAX_ROUTES: usize = 64;

/// Listens to all services. Nothing is joined: what has come is handed on one by one, oldest first by the time of the
/// sensors, each frame borrowed from shared memory. Of a stage that is swapped what every other reader takes: each frame once, of the
/// instance that is listened to; the words that say which it is are handed on too.
///
/// A frame is done with when every service that a stage writes has passed it on. The stream has ended when all of them
/// say so: the last deskewed scan, pose and map update come after the last scan.
pub struct TapJoin {
    scans: Tap<FrameSubscriber<LidarScan>>,
    deskewed: Tap<FrameSubscriber<ScanDeskewed>>,
    map: Tap<FrameSubscriber<MapUpdate>>,
    grid: Tap<FrameSubscriber<GridPlan>>,
    imu: Tap<RecordSubscriber<Imu>>,
    poses: Tap<RecordSubscriber<OdometryPose>>,
    truth: Tap<RecordSubscriber<TruthPose>>,
    health: Tap<RecordSubscriber<HealthStatus>>,
    attitude: Tap<RecordSubscriber<Attitude>>,
    /// The launcher's words that are not handed on yet.
    routes: VecDeque<Route>,
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
        "imu/attitude",
        "route",
    ];
    type Frame<'a> = Tapped<'a>;

    fn open(bus: &Bus, _options: JoinOptions) -> Result<(Self, Vec<Listener>), PortError> {
        let mut listeners = Vec::new();
        let join = Self {
            scans: Tap::new(listening(FrameSubscriber::open(bus)?, &mut listeners), MAX_HELD),
            deskewed: Tap::new(listening(FrameSubscriber::open(bus)?, &mut listeners), MAX_HELD)
                .gated(ScanDeskewed::NAME),
            map: Tap::new(listening(FrameSubscriber::open(bus)?, &mut listeners), MAX_HELD)
                .gated(MapUpdate::NAME),
            // A subscriber may borrow two.
            grid: Tap::new(listening(FrameSubscriber::open(bus)?, &mut listeners), 1),
            imu: Tap::new(listening(RecordSubscriber::open(bus)?, &mut listeners), MAX_RECORDS),
            poses: Tap::new(listening(RecordSubscriber::open(bus)?, &mut listeners), MAX_RECORDS)
                .gated(OdometryPose::NAME),
            truth: Tap::new(listening(RecordSubscriber::open(bus)?, &mut listeners), MAX_RECORDS),
            health: Tap::new(listening(RecordSubscriber::open(bus)?, &mut listeners), MAX_RECORDS),
            attitude: Tap::new(listening(RecordSubscriber::open(bus)?, &mut listeners), MAX_RECORDS),
            routes: VecDeque::with_capacity(MAX_ROUTES),
            now_ns: 0,
            next: 0,
        };
        Ok((join, listeners))
    }

    fn route(&mut self, route: &Route) {
        self.deskewed.route(route);
        self.poses.route(route);
        self.map.route(route);
        self.routes.push_back(*route);
    }

    /// Nothing is held back: a recorder is not swapped, it is ended and another begun.
    fn limit(&mut self, _seq: u64) {}

    fn front(&self) -> Option<u64> {
        None
    }

    fn take_in(&mut self, reporter: &mut Reporter) -> Result<(), PortError> {
        self.scans.take_in(reporter, |sample| sample.header().frame)?;
        self.deskewed.take_in(reporter, |sample| sample.header().frame)?;
        self.map.take_in(reporter, |sample| sample.header().frame)?;
        self.grid.take_in(reporter, |sample| sample.header().frame)?;
        self.imu.take_in(reporter, frame_of)?;
        self.poses.take_in(reporter, |pose| pose.frame)?;
        self.truth.take_in(reporter, |pose| pose.frame)?;
        self.attitude.take_in(reporter, frame_of_attitude)?;
        self.health.take_in(reporter, |health| frame_at(health.reported_ns, 0))
    }

    fn next<R>(
        &mut self,
        reporter: &mut Reporter,
        process: impl FnOnce(Self::Frame<'_>, &FrameHeader, &mut Reporter) -> R,
    ) -> Option<R> {
        if let Some(route) = self.routes.pop_front() {
            let frame = frame_at(now_ns(), self.now_ns);
            return Some(process(Tapped::Route(&route, self.now_ns), &frame, reporter));
        }
        let times = [
            self.imu.queue.front().map(|sample| sample.stamp_ns),
            self.scans.queue.front().map(|scan| scan.header().frame.end_ns),
            self.truth.queue.front().map(|pose| pose.frame.end_ns),
            self.deskewed.queue.front().map(|scan| scan.header().frame.end_ns),
            self.poses.queue.front().map(|pose| pose.frame.end_ns),
            self.map.queue.front().map(|update| update.header().frame.end_ns),
            self.grid.queue.front().map(|grid| grid.header().frame.end_ns),
            self.attitude.queue.front().map(|attitude| attitude.stamp_ns),
        ];
        let oldest = times.into_iter().enumerate().filter_map(|(at, time)| Some((time?, at))).min();
        if let Some((time_ns, _)) = oldest {
            self.now_ns = time_ns;
        }
        match oldest.map(|(_, at)| at) {
            Some(0) => {
                let sample = self.imu.queue.pop_front()?;
                let frame = self.imu.pass(&frame_of(&sample), |input| &mut input.imu_lost, reporter);
                Some(process(Tapped::Imu(&sample), &frame, reporter))
            }
            Some(1) => {
                let scan = self.scans.queue.pop_front()?;
                let frame = self.scans.pass(&scan.header().frame, |input| &mut input.lost, reporter);
                Some(process(Tapped::Scan(scan.header(), scan.items()), &frame, reporter))
            }
            Some(2) => {
                let pose = self.truth.queue.pop_front()?;
                let frame = self.truth.pass(&pose.frame, |input| &mut input.lost, reporter);
                Some(process(Tapped::Truth(&pose), &frame, reporter))
            }
            Some(3) => {
                let scan = self.deskewed.queue.pop_front()?;
                let frame = self.deskewed.pass(&scan.header().frame, |input| &mut input.lost, reporter);
                Some(process(Tapped::Deskewed(scan.header(), scan.items()), &frame, reporter))
            }
            Some(4) => {
                let pose = self.poses.queue.pop_front()?;
                let frame = self.poses.pass(&pose.frame, |input| &mut input.lost, reporter);
                Some(process(Tapped::Pose(&pose), &frame, reporter))
            }
            Some(5) => {
                let update = self.map.queue.pop_front()?;
                let frame = self.map.pass(&update.header().frame, |input| &mut input.lost, reporter);
                let message = MapMessage { header: update.header(), voxels: update.items() };
                Some(process(Tapped::Map(message), &frame, reporter))
            }
            Some(6) => {
                let grid = self.grid.queue.pop_front()?;
                // Plans come now and then: their numbers have gaps that are none.
                let frame = grid.header().frame;
                Some(process(Tapped::Grid(grid.header(), cells(&grid)), &frame, reporter))
            }
            Some(_) => {
                let attitude = self.attitude.queue.pop_front()?;
                Some(process(Tapped::Attitude(&attitude), &frame_of_attitude(&attitude), reporter))
            }
            None => {
                let health = self.health.queue.pop_front()?;
                let frame = frame_at(health.reported_ns, self.now_ns);
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

/// The port of a service, whose listener is put with the others.
fn listening<P>((port, listener): (P, Listener), listeners: &mut Vec<Listener>) -> P {
    listeners.push(listener);
    port
}

/// An IMU sample as it is counted.
fn frame_of(sample: &ImuSample) -> FrameHeader {
    let ImuSample { seq, stamp_ns, arrival_ns, sent_ns, epoch, flags, .. } = *sample;
    FrameHeader { seq, start_ns: stamp_ns, end_ns: stamp_ns, arrival_ns, sent_ns, epoch, flags }
}

/// An attitude as it is counted.
fn frame_of_attitude(attitude: &ImuAttitude) -> FrameHeader {
    let ImuAttitude { seq, stamp_ns, arrival_ns, sent_ns, epoch, .. } = *attitude;
    FrameHeader { seq, start_ns: stamp_ns, end_ns: stamp_ns, arrival_ns, sent_ns, epoch, flags: 0 }
}

/// What has no time of a sensor of its own, as it is counted.
fn frame_at(sent_ns: i64, now_ns: i64) -> FrameHeader {
    FrameHeader { start_ns: now_ns, end_ns: now_ns, arrival_ns: sent_ns, sent_ns, ..FrameHeader::default() }
}

fn cells(grid: &FrameSample<GridPlan>) -> &[u8] {
    bytemuck::cast_slice(grid.items())
}

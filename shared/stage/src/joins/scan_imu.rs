//! A scan with the IMU data that covers it (paper section 2.2, synchronisation of both streams).

use std::collections::VecDeque;

use evac_frames::{FrameHeader, ImuSample, PoseFrame, Route, ScanHeader, frame_flags};
use evac_ports::services::{FrameService, Imu, LidarScan, OdometryPose, ScanDeskewed};
use evac_ports::{Bus, FrameSample, Listener, PortError, RecordSubscriber, now_ns};

use super::gated::{GatedFrames, GatedRecords};
use super::seq::SeqTracker;
use super::{Join, JoinOptions, MAX_HELD};
use crate::{InputCounters, Reporter, ScanWithImu};

/// Input of the deskewer: raw scans, IMU, and the pose before as motion prior.
pub type RawScanWithImu = ScanImuJoin<LidarScan, true>;
/// Input of an odometry: deskewed scans and IMU.
pub type DeskewedScanWithImu = ScanImuJoin<ScanDeskewed, false>;

/// IMU samples kept: 20 s at 200 Hz; a LiDAR that is silent for longer starts anew.
const MAX_IMU: usize = 4096;

/// Poses kept as priors: a standby is a few scans behind the odometry.
const MAX_PRIORS: usize = 32;

/// So many samples in a row from before the newest one are no stragglers: the sensor's clock was set back, or the newest
/// one's stamp was wrong.
const MAX_BEHIND: u32 = 40;

/// Joins scans with the IMU samples that cover them and, if `PRIOR`, with the pose of the scan before.
#[derive(Debug)]
pub struct ScanImuJoin<S: FrameService<Header = ScanHeader>, const PRIOR: bool> {
    scans: GatedFrames<S>,
    imu_port: RecordSubscriber<Imu>,
    pose_port: Option<GatedRecords<OdometryPose>>,
    options: JoinOptions,
    held: VecDeque<(FrameSample<S>, i64)>,
    imu: Vec<ImuSample>,
    imu_ended: bool,
    /// Samples in a row that were not later than the newest.
    behind: u32,
    /// In order; all but the first are of scans that have not been handed on.
    priors: VecDeque<PoseFrame>,
    previous_end_ns: Option<i64>,
    imu_seq: SeqTracker,
    imu_epoch: u32,
    limit: u64,
}

impl<S, const PRIOR: bool> Join for ScanImuJoin<S, PRIOR>
where
    S: FrameService<Header = ScanHeader, Item = evac_frames::Point>,
{
    const SERVICES: &'static [&'static str] =
        if PRIOR { &[S::NAME, "imu/sample", "odometry/pose"] } else { &[S::NAME, "imu/sample"] };
    type Frame<'a> = ScanWithImu<'a>;

    fn open(bus: &Bus, options: JoinOptions) -> Result<(Self, Vec<Listener>), PortError> {
        let (scans, scan_listener) = GatedFrames::open(bus)?;
        let (imu_port, imu_listener) = RecordSubscriber::open(bus)?;
        let mut listeners = vec![scan_listener, imu_listener];
        let mut pose_port = None;
        if PRIOR {
            let (port, listener) = GatedRecords::open(bus)?;
            pose_port = Some(port);
            // Live, a pose waits for the next scan; only who waits for the pose is woken by it.
            if options.lossless {
                listeners.push(listener);
            }
        }
        let join = Self {
            scans,
            imu_port,
            pose_port,
            options,
            held: VecDeque::with_capacity(MAX_HELD + 1),
            imu: Vec::with_capacity(MAX_IMU),
            imu_ended: false,
            behind: 0,
            priors: VecDeque::with_capacity(MAX_PRIORS + 1),
            previous_end_ns: None,
            imu_seq: SeqTracker::default(),
            imu_epoch: 0,
            limit: u64::MAX,
        };
        Ok((join, listeners))
    }

    fn route(&mut self, route: &Route) {
        self.scans.route(route);
        self.pose_port.iter_mut().for_each(|port| port.route(route));
    }

    fn limit(&mut self, seq: u64) {
        self.limit = seq;
    }

    fn front(&self) -> Option<u64> {
        self.held.front().map(|(scan, _)| scan.header().frame.seq)
    }

    fn take_in(&mut self, reporter: &mut Reporter) -> Result<(), PortError> {
        if let Some(port) = &mut self.pose_port {
            // A pose that is missing is no frame lost: the next one is as good a prior.
            while let Some(pose) = port.receive(&mut InputCounters::default())? {
                if self.priors.len() == MAX_PRIORS {
                    self.priors.pop_front();
                }
                self.priors.push_back(pose);
            }
        }
        // What there is no room for stays where it is.
        while self.held.len() < MAX_HELD
            && let Some(scan) = self.scans.receive(&mut reporter.input)?
        {
            reporter.received(scan.header().frame.sent_ns);
            self.held.push_back((scan, now_ns()));
        }
        while let Some(sample) = self.imu_port.receive()? {
            self.take_imu(sample, reporter);
        }
        Ok(())
    }

    fn next<R>(
        &mut self,
        reporter: &mut Reporter,
        process: impl FnOnce(Self::Frame<'_>, &FrameHeader, &mut Reporter) -> R,
    ) -> Option<R> {
        let waited_too_long = self.deadline_ns().is_some_and(|deadline| now_ns() >= deadline);
        let frame = self.held.front().map(|(scan, _)| scan.header().frame)?;
        if frame.seq >= self.limit {
            return None;
        }
        // The latest pose before this scan.
        while self.priors.get(1).is_some_and(|second| second.frame.seq < frame.seq) {
            self.priors.pop_front();
        }
        let (scan, _) = self.held.front()?;
        let imu_end_ns = scan.header().imu_end_ns(self.time_offset_ns(scan.header()));
        let covered = self.imu_ended || self.imu.last().is_some_and(|last| last.stamp_ns >= imu_end_ns);
        let complete = covered && self.prior_is_here(&frame);
        if !complete {
            if !waited_too_long {
                return None;
            }
            reporter.input.late += 1;
        }
        let (scan, _) = self.held.pop_front()?;
        let from_ns = self.previous_end_ns.map_or(i64::MIN, |end| end.min(frame.start_ns));
        let first = last_at_or_before(&self.imu, from_ns);
        let end = (self.imu.partition_point(|sample| sample.stamp_ns < imu_end_ns) + 1).min(self.imu.len());
        let input = ScanWithImu {
            header: scan.header(),
            points: scan.items(),
            imu: self.imu.get(first..end).unwrap_or_default(),
            imu_covers: covered,
            prior: self.priors.front().filter(|prior| PRIOR && prior.frame.seq < frame.seq),
        };
        let result = process(input, &frame, reporter);
        self.previous_end_ns = Some(frame.end_ns);
        // From this frame's start on, since the next one may overlap it.
        self.imu.drain(..last_at_or_before(&self.imu, frame.start_ns.min(frame.end_ns)));
        Some(result)
    }

    fn deadline_ns(&self) -> Option<i64> {
        let (scan, received_ns) = self.held.front()?;
        (scan.header().frame.seq < self.limit).then(|| received_ns.saturating_add(self.options.patience_ns))
    }
}

impl<S: FrameService<Header = ScanHeader>, const PRIOR: bool> ScanImuJoin<S, PRIOR> {
    fn take_imu(&mut self, sample: ImuSample, reporter: &mut Reporter) {
        let mut rises = self.imu.last().is_none_or(|last| sample.stamp_ns > last.stamp_ns);
        // Another producer's: what it repeats is old, and with the first that is new it counts as it will.
        if sample.epoch != self.imu_epoch && rises {
            self.imu_epoch = sample.epoch;
            if self.imu_seq.passed().is_some_and(|next| sample.seq < next) {
                self.imu_seq = SeqTracker::default();
            }
        }
        let gap = self.imu_seq.gap(sample.seq);
        reporter.input.imu_lost += gap.unwrap_or(0);
        if gap.is_some() {
            self.imu_ended = sample.flags & frame_flags::END_OF_STREAM != 0;
            // The mark may come on the last sample itself, or on a copy of it that is no measurement of its own.
            if self.imu_ended && (self.imu.is_empty() || !rises) {
                return;
            }
        }
        self.behind = if rises || gap.is_none() { 0 } else { self.behind + 1 };
        if self.behind > MAX_BEHIND {
            self.imu.clear();
            (self.behind, self.previous_end_ns) = (0, None);
            rises = true;
        }
        let finite = sample.gyro.iter().chain(&sample.accel).all(|value| value.is_finite());
        if gap.is_none() || !rises || !finite {
            reporter.input.imu_rejected += 1;
            return;
        }
        if self.imu.len() == MAX_IMU {
            self.imu.drain(..MAX_IMU / 2);
            // Before the first scan they are of no use to anyone.
            reporter.input.imu_lost += if self.previous_end_ns.is_some() { MAX_IMU as u64 / 2 } else { 0 };
        }
        self.imu.push(sample);
    }

    /// What is known of the offset to add to IMU stamps: the deskewer learns it from the pose before, an odometry from the
    /// deskewer.
    fn time_offset_ns(&self, header: &ScanHeader) -> i64 {
        match self.priors.front() {
            Some(prior) if PRIOR => prior.time_offset_ns,
            _ => header.time_offset_ns(),
        }
    }

    /// In lossless mode the deskewer works with the pose of exactly the scan before, so that every run is the same.
    fn prior_is_here(&self, frame: &FrameHeader) -> bool {
        let waits =
            PRIOR && self.options.lossless && self.options.has_odometry && self.previous_end_ns.is_some();
        !waits || self.priors.front().is_some_and(|prior| prior.frame.seq + 1 >= frame.seq)
    }
}

/// Index of the last sample at or before `time_ns`, 0 where there is none.
fn last_at_or_before(imu: &[ImuSample], time_ns: i64) -> usize {
    imu.partition_point(|sample| sample.stamp_ns <= time_ns).saturating_sub(1)
}

//! A deskewed scan with its pose.

use std::collections::VecDeque;

use evac_frames::{FrameHeader, PoseFrame, Route};
use evac_ports::services::{OdometryPose, ScanDeskewed};
use evac_ports::{Bus, FrameSample, Listener, PortError, now_ns};

use super::gated::{GatedFrames, GatedRecords};
use super::{Join, JoinOptions, MAX_HELD};
use crate::{InputCounters, Reporter, ScanWithPose};

/// Time after which the scan of a pose will not come any more, nanoseconds.
const SCAN_COMES_NS: i64 = 500_000_000;

/// Shortest and longest time between two looks for it, nanoseconds.
const LOOK_AGAIN_NS: (i64, i64) = (500_000, 16_000_000);

/// Joins deskewed scans with the poses of the same sequence number.
#[derive(Debug)]
pub struct ScanPoseJoin {
    scans: GatedFrames<ScanDeskewed>,
    poses: GatedRecords<OdometryPose>,
    held: VecDeque<FrameSample<ScanDeskewed>>,
    waiting: VecDeque<PoseFrame>,
    limit: u64,
    newest_scan: Option<u64>,
    /// When the newest pose came, host monotonic time.
    pose_came_ns: i64,
}

impl Join for ScanPoseJoin {
    const SERVICES: &'static [&'static str] = &["scan/deskewed", "odometry/pose"];
    type Frame<'a> = ScanWithPose<'a>;

    fn open(bus: &Bus, _options: JoinOptions) -> Result<(Self, Vec<Listener>), PortError> {
        // A scan alone wakes nobody here: without its pose nothing can be done with it, and the odometry, which is woken by the same scan,
        // would share its core.
        let (scans, _) = GatedFrames::open(bus)?;
        let (poses, pose_listener) = GatedRecords::open(bus)?;
        let join = Self {
            scans,
            poses,
            held: VecDeque::with_capacity(MAX_HELD + 1),
            waiting: VecDeque::with_capacity(MAX_HELD + 1),
            limit: u64::MAX,
            newest_scan: None,
            pose_came_ns: 0,
        };
        Ok((join, vec![pose_listener]))
    }

    fn route(&mut self, route: &Route) {
        self.scans.route(route);
        self.poses.route(route);
    }

    fn limit(&mut self, seq: u64) {
        self.limit = seq;
    }

    fn front(&self) -> Option<u64> {
        self.held.front().map(|scan| scan.header().frame.seq)
    }

    fn take_in(&mut self, reporter: &mut Reporter) -> Result<(), PortError> {
        loop {
            // Poses first: a pose is published after its scan, so of those that were taken here no scan is still on its way.
            while self.waiting.len() < MAX_HELD
                && let Some(pose) = self.poses.receive(&mut InputCounters::default())?
            {
                reporter.received(pose.frame.sent_ns);
                self.pose_came_ns = now_ns();
                self.waiting.push_back(pose);
            }
            // What there is no room for stays where it is.
            while self.held.len() < MAX_HELD
                && let Some(scan) = self.scans.receive(&mut reporter.input)?
            {
                self.newest_scan = Some(scan.header().frame.seq);
                self.held.push_back(scan);
            }
            if !self.pass_by(reporter) {
                return Ok(());
            }
        }
    }

    fn next<R>(
        &mut self,
        reporter: &mut Reporter,
        process: impl FnOnce(Self::Frame<'_>, &FrameHeader, &mut Reporter) -> R,
    ) -> Option<R> {
        self.pass_by(reporter);
        let (scan, pose) = (self.held.front()?, self.waiting.front()?);
        if scan.header().frame.seq >= self.limit || scan.header().frame.seq != pose.frame.seq {
            return None;
        }
        let (scan, pose) = (self.held.pop_front()?, self.waiting.pop_front()?);
        let input = ScanWithPose { header: scan.header(), points: scan.items(), pose: &pose };
        Some(process(input, &pose.frame, reporter))
    }

    /// Looks again while a pose is here and its scan is not: the deskewer has handed it to the odometry, but to this stage not yet. Soon
    /// at first, then after as long again as it has waited: mostly the deskewer has lost its core for a moment, now and then its life.
    fn deadline_ns(&self) -> Option<i64> {
        let pose = self.waiting.back()?;
        let is_ahead = self.newest_scan.is_none_or(|newest| pose.frame.seq > newest);
        let now = now_ns();
        let waited_ns = now.saturating_sub(self.pose_came_ns);
        let (soonest, latest) = LOOK_AGAIN_NS;
        (is_ahead && waited_ns < SCAN_COMES_NS).then(|| now + waited_ns.clamp(soonest, latest))
    }
}

impl ScanPoseJoin {
    /// Is done with what has no partner; whether there was any.
    fn pass_by(&mut self, reporter: &mut Reporter) -> bool {
        let mut passed = false;
        while let (Some(scan), Some(pose)) = (self.held.front(), self.waiting.front()) {
            let seq = scan.header().frame.seq;
            if seq >= self.limit || seq == pose.frame.seq {
                break;
            }
            passed = true;
            if pose.frame.seq < seq {
                // Its scan came before this stage did, or was lost and is counted.
                self.waiting.pop_front();
            } else {
                // The odometry has passed this scan by: its pose was lost.
                self.held.pop_front();
                reporter.input.late += 1;
            }
        }
        passed
    }
}

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
        // Poses first: a pose is published after its scan, so the scan of every pose taken here is here too.
        while let Some(pose) = self.poses.receive(&mut InputCounters::default())? {
            reporter.received(pose.frame.sent_ns);
            self.pose_came_ns = now_ns();
            self.waiting.push_back(pose);
            if self.waiting.len() > MAX_HELD {
                // Its scan is counted when a later pose passes it by.
                self.waiting.pop_front();
            }
        }
        while let Some(scan) = self.scans.receive(&mut reporter.input)? {
            self.newest_scan = Some(scan.header().frame.seq);
            self.held.push_back(scan);
            if self.held.len() > MAX_HELD {
                self.held.pop_front();
                reporter.input.lost += 1;
            }
        }
        Ok(())
    }

    fn next<R>(
        &mut self,
        reporter: &mut Reporter,
        process: impl FnOnce(Self::Frame<'_>, &FrameHeader, &mut Reporter) -> R,
    ) -> Option<R> {
        loop {
            let (scan, pose) = (self.held.front()?, self.waiting.front()?);
            let frame = scan.header().frame;
            if frame.seq >= self.limit {
                return None;
            }
            match pose.frame.seq.cmp(&frame.seq) {
                std::cmp::Ordering::Equal => break,
                // Its scan came before this stage did, or was lost and is counted.
                std::cmp::Ordering::Less => self.waiting.pop_front().map(|_| ()),
                // The odometry has passed this scan by: its pose was lost.
                std::cmp::Ordering::Greater => self.held.pop_front().map(|_| reporter.input.late += 1),
            };
        }
        let (scan, pose) = (self.held.pop_front()?, self.waiting.pop_front()?);
        let input = ScanWithPose { header: scan.header(), points: scan.items(), pose: &pose };
        Some(process(input, &pose.frame, reporter))
    }

    /// Looks again at once while a pose is here and its scan is not: the deskewer has handed it to the odometry, but to this stage not yet.
    fn deadline_ns(&self) -> Option<i64> {
        let pose = self.waiting.back()?;
        let is_ahead = self.newest_scan.is_none_or(|newest| pose.frame.seq > newest);
        (is_ahead && now_ns() < self.pose_came_ns.saturating_add(SCAN_COMES_NS)).then_some(0)
    }
}

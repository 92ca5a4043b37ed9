//! What a swap must not do, seen from outside: frames lost or doubled at the sinks, jumps and gaps of the pose stream.

use std::collections::{BTreeMap, VecDeque};

use evac_frames::{Ack, Health, PoseFrame, TrackingState};
use evac_geometry::map_from_lidar;
use evac_ports::services::{OdometryPose, TruthPose};
use evac_ports::{Bus, Listener, PortError, RecordSubscriber};

use super::swaps_report::{Cut, Gap, Swaps};

/// A gap of the pose stream longer than this is listed, 1.5 periods.
const LONG_GAP_NS: i64 = 150_000_000;
/// True poses kept until the pose of their scan comes.
const MAX_TRUTH: usize = 256;

/// Follows poses and acknowledgements.
#[derive(Debug)]
pub(super) struct Monitor {
    poses: RecordSubscriber<OdometryPose>,
    truths: RecordSubscriber<TruthPose>,
    pub(super) listeners: Vec<Listener>,
    truth: VecDeque<PoseFrame>,
    last: Option<PoseFrame>,
    /// The next frame wanted and the newest epoch, by sink.
    sinks: BTreeMap<String, (u64, u32)>,
    frames: u64,
    lost: u64,
    doubled: u64,
    cuts: Vec<Cut>,
    /// Worst step that is no cut, metres.
    elsewhere_m: f64,
    gap_ns: i64,
    long_gaps: Vec<Gap>,
}

impl Monitor {
    pub(super) fn open(bus: &Bus) -> Result<Self, PortError> {
        let (poses, pose_listener) = RecordSubscriber::open(bus)?;
        let (truths, truth_listener) = RecordSubscriber::open(bus)?;
        Ok(Self {
            poses,
            truths,
            listeners: vec![pose_listener, truth_listener],
            truth: VecDeque::with_capacity(MAX_TRUTH + 1),
            last: None,
            sinks: BTreeMap::new(),
            frames: 0,
            lost: 0,
            doubled: 0,
            cuts: Vec::new(),
            elsewhere_m: 0.0,
            gap_ns: 0,
            long_gaps: Vec::new(),
        })
    }

    pub(super) fn take_in(&mut self) -> Result<(), PortError> {
        while let Some(truth) = self.truths.receive()? {
            self.truth.push_back(truth);
            if self.truth.len() > MAX_TRUTH {
                self.truth.pop_front();
            }
        }
        while let Some(pose) = self.poses.receive()? {
            self.take_pose(&pose);
        }
        Ok(())
    }

    fn take_pose(&mut self, pose: &PoseFrame) {
        // What a killed odometry said last is said once more by the next one.
        if self.last.is_some_and(|last| pose.frame.seq <= last.frame.seq) {
            return;
        }
        self.frames += 1;
        if let Some(last) = self.last.replace(*pose) {
            let gap_ns = pose.frame.sent_ns - last.frame.sent_ns;
            self.gap_ns = self.gap_ns.max(gap_ns);
            if gap_ns > LONG_GAP_NS {
                self.long_gaps.push(Gap { seq: pose.frame.seq, ms: gap_ns as f64 * 1e-6 });
            }
            let error = self.step_error(&last, pose);
            if last.frame.epoch != pose.frame.epoch {
                // A step that cannot be judged is no good one.
                let (off_m, off_rad) = error.unwrap_or((f64::INFINITY, f64::INFINITY));
                self.cuts.push(Cut { seq: pose.frame.seq, off_m, off_deg: off_rad.to_degrees() });
            } else if let Some((off_m, _)) = error {
                self.elsewhere_m = self.elsewhere_m.max(off_m);
            }
        }
    }

    /// The newest pose's frame.
    pub(super) fn newest(&self) -> u64 {
        self.last.map_or(0, |last| last.frame.seq)
    }

    /// How far the step between two poses is off the true one, metres and radians; nothing where an odometry does not track.
    fn step_error(&self, before: &PoseFrame, after: &PoseFrame) -> Option<(f64, f64)> {
        let tracks = |pose: &PoseFrame| {
            matches!(pose.tracking_state(), Some(TrackingState::Tracking | TrackingState::Degenerate))
        };
        if !(tracks(before) && tracks(after)) {
            return None;
        }
        let truth = |seq: u64| self.truth.iter().find(|truth| truth.frame.seq == seq);
        let (true_before, true_after) = (truth(before.frame.seq)?, truth(after.frame.seq)?);
        let step = |a: &PoseFrame, b: &PoseFrame| map_from_lidar(a).inverse() * map_from_lidar(b);
        let error = step(true_before, true_after).inverse() * step(before, after);
        Some((error.translation.vector.norm(), error.rotation.angle()))
    }

    pub(super) fn take_ack(&mut self, ack: &Ack) {
        let name = Health::text_of(&ack.name);
        let (next, epoch) = self.sinks.entry(name).or_insert((ack.seq, ack.epoch));
        // A sink that takes over from a killed one says its last word once more.
        let is_word_again = ack.epoch > *epoch && ack.seq + 1 == *next;
        if !is_word_again {
            self.lost += ack.seq.saturating_sub(*next);
            self.doubled += u64::from(ack.seq < *next);
        }
        (*next, *epoch) = (ack.seq.saturating_add(1).max(*next), ack.epoch);
    }

    pub(super) fn finish(&self, swaps: &mut Swaps) {
        swaps.frames = self.frames;
        swaps.lost = self.lost;
        swaps.doubled = self.doubled;
        swaps.odometry_cuts.clone_from(&self.cuts);
        swaps.elsewhere_m = self.elsewhere_m;
        swaps.long_gaps.clone_from(&self.long_gaps);
        swaps.longest_gap_ms = self.gap_ns as f64 * 1e-6;
    }
}

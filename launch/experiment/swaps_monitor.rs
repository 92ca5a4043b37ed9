//! What a swap must not do, seen from outside: frames lost or doubled at the sinks, jumps and gaps of the pose stream.

use std::collections::{BTreeMap, VecDeque};

use evac_frames::{Ack, Health, PoseFrame, TrackingState};
use evac_geometry::map_from_lidar;
use evac_ports::services::{OdometryPose, TruthPose};
use evac_ports::{Bus, Listener, PortError, RecordSubscriber};

use super::swaps_report::Swaps;

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
    cuts: u64,
    jump_m: f64,
    jump_rad: f64,
    gap_ns: i64,
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
            cuts: 0,
            jump_m: 0.0,
            jump_rad: 0.0,
            gap_ns: 0,
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
            self.gap_ns = self.gap_ns.max(pose.frame.sent_ns - last.frame.sent_ns);
            if last.frame.epoch != pose.frame.epoch {
                self.cuts += 1;
                self.measure_cut(&last, pose);
            }
        }
    }

    /// How far the step across a cut is off the true one.
    fn measure_cut(&mut self, before: &PoseFrame, after: &PoseFrame) {
        let tracks = |pose: &PoseFrame| {
            matches!(pose.tracking_state(), Some(TrackingState::Tracking | TrackingState::Degenerate))
        };
        let truth = |seq: u64| self.truth.iter().find(|truth| truth.frame.seq == seq);
        let (Some(true_before), Some(true_after)) = (truth(before.frame.seq), truth(after.frame.seq)) else {
            return;
        };
        let step = |a: &PoseFrame, b: &PoseFrame| map_from_lidar(a).inverse() * map_from_lidar(b);
        let error = step(true_before, true_after).inverse() * step(before, after);
        if tracks(before) && tracks(after) {
            self.jump_m = self.jump_m.max(error.translation.vector.norm());
            self.jump_rad = self.jump_rad.max(error.rotation.angle());
        } else {
            self.jump_m = f64::INFINITY;
        }
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
        swaps.odometry_cuts = self.cuts;
        swaps.jump_m = self.jump_m;
        swaps.jump_deg = self.jump_rad.to_degrees();
        swaps.longest_gap_ms = self.gap_ns as f64 * 1e-6;
    }
}

//! What a swap must not do, seen from outside: frames lost or doubled at the sinks, jumps and gaps of the pose stream.

use std::collections::BTreeMap;

use evac_frames::{Ack, Health, PoseFrame};
use evac_ports::services::{OdometryPose, TruthPose};
use evac_ports::{Bus, Listener, PortError, RecordSubscriber};

use super::swaps_poses::Poses;
use super::swaps_report::Swaps;

/// Follows poses and acknowledgements.
#[derive(Debug)]
pub(super) struct Monitor {
    poses: RecordSubscriber<OdometryPose>,
    truths: RecordSubscriber<TruthPose>,
    pub(super) listeners: Vec<Listener>,
    /// Poses that have come, until they are sorted.
    come: Vec<PoseFrame>,
    seen: Poses,
    /// The next frame wanted and the newest epoch, by sink.
    sinks: BTreeMap<String, (u64, u32)>,
    lost: u64,
    doubled: u64,
}

impl Monitor {
    pub(super) fn open(bus: &Bus) -> Result<Self, PortError> {
        let (poses, pose_listener) = RecordSubscriber::open(bus)?;
        let (truths, truth_listener) = RecordSubscriber::open(bus)?;
        Ok(Self {
            poses,
            truths,
            listeners: vec![pose_listener, truth_listener],
            come: Vec::new(),
            seen: Poses::default(),
            sinks: BTreeMap::new(),
            lost: 0,
            doubled: 0,
        })
    }

    pub(super) fn take_in(&mut self) -> Result<(), PortError> {
        while let Some(truth) = self.truths.receive()? {
            self.seen.take_truth(truth);
        }
        while let Some(pose) = self.poses.receive()? {
            self.come.push(pose);
        }
        self.seen.take(&mut self.come);
        Ok(())
    }

    /// The newest pose's frame.
    pub(super) fn newest(&self) -> u64 {
        self.seen.newest()
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
        swaps.lost = self.lost;
        swaps.doubled = self.doubled;
        self.seen.finish(swaps);
    }
}

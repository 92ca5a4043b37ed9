//! Listens to a running pipeline from outside, without the gates that its stages read through: what comes twice or not at all shows.
#![allow(dead_code)] // not every test needs all of it

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use evac_frames::{Ack, FrameHeader, Health, PoseFrame, TrackingState};
use evac_geometry::map_from_lidar;
use evac_ports::services::{MapUpdate, OdometryPose, ScanDeskewed, SinkAck, TruthPose};
use evac_ports::{Bus, Domain, FrameSubscriber, RecordSubscriber};

/// Everything that was heard.
#[derive(Default)]
pub(crate) struct Heard {
    pub(crate) scans: Vec<FrameHeader>,
    pub(crate) poses: Vec<PoseFrame>,
    pub(crate) updates: Vec<FrameHeader>,
    pub(crate) truth: BTreeMap<u64, PoseFrame>,
    pub(crate) acks: Vec<Ack>,
}

pub(crate) struct Observer {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Heard>,
}

impl Observer {
    /// Listens from now on; the domain must be up.
    pub(crate) fn start(domain: &Domain) -> Self {
        let (domain, stop) = (domain.clone(), Arc::new(AtomicBool::new(false)));
        let (flag, (ready, is_ready)) = (stop.clone(), std::sync::mpsc::channel());
        let thread = std::thread::spawn(move || {
            let bus = Bus::join(&domain, "observer").unwrap();
            let (scans, _) = FrameSubscriber::<ScanDeskewed>::open(&bus).unwrap();
            let (poses, _) = RecordSubscriber::<OdometryPose>::open(&bus).unwrap();
            let (updates, _) = FrameSubscriber::<MapUpdate>::open(&bus).unwrap();
            let (truth, _) = RecordSubscriber::<TruthPose>::open(&bus).unwrap();
            let (acks, _) = RecordSubscriber::<SinkAck>::open(&bus).unwrap();
            ready.send(()).unwrap();
            let mut heard = Heard::default();
            loop {
                // Once more after the stop.
                let is_last = flag.load(Ordering::Relaxed);
                while let Some(scan) = scans.receive().unwrap() {
                    heard.scans.push(scan.header().frame);
                }
                while let Some(pose) = poses.receive().unwrap() {
                    heard.poses.push(pose);
                }
                while let Some(update) = updates.receive().unwrap() {
                    heard.updates.push(update.header().frame);
                }
                while let Some(pose) = truth.receive().unwrap() {
                    heard.truth.insert(pose.frame.seq, pose);
                }
                while let Some(ack) = acks.receive().unwrap() {
                    heard.acks.push(ack);
                }
                if is_last {
                    return heard;
                }
                std::thread::sleep(Duration::from_millis(5));
            }
        });
        is_ready.recv().unwrap();
        Self { stop, thread }
    }

    pub(crate) fn stop(self) -> Heard {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

impl Heard {
    /// Numbers of the acknowledgements of one sink.
    pub(crate) fn acks_of(&self, sink: &str) -> Vec<u64> {
        let name: [u8; 24] = Health::text(sink);
        self.acks.iter().filter(|ack| ack.name == name).map(|ack| ack.seq).collect()
    }

    /// How far the way between two poses is off at each cut from one instance to another, metres and radians, by the first frame of
    /// the new one.
    pub(crate) fn jumps(&self) -> Vec<(u64, f64, f64)> {
        let tracks = |pose: &PoseFrame| {
            matches!(pose.tracking_state(), Some(TrackingState::Tracking | TrackingState::Degenerate))
        };
        let cuts = self.poses.windows(2).filter(|pair| pair[0].frame.epoch != pair[1].frame.epoch);
        cuts.map(|pair| {
            assert!(tracks(&pair[0]) && tracks(&pair[1]), "{pair:?}");
            let step = |a: &PoseFrame, b: &PoseFrame| map_from_lidar(a).inverse() * map_from_lidar(b);
            let truth = [0, 1].map(|i| &self.truth[&pair[i].frame.seq]);
            let error = step(truth[0], truth[1]).inverse() * step(&pair[0], &pair[1]);
            (pair[1].frame.seq, error.translation.vector.norm(), error.rotation.angle())
        })
        .collect()
    }

    /// Longest time between two poses' hand-overs, seconds.
    pub(crate) fn longest_gap_s(&self) -> f64 {
        let gaps = self.poses.windows(2).map(|pair| pair[1].frame.sent_ns - pair[0].frame.sent_ns);
        gaps.max().unwrap_or(0) as f64 * 1e-9
    }
}

/// Every number once and in order.
#[track_caller]
pub(crate) fn assert_gap_free(what: &str, seqs: impl IntoIterator<Item = u64>) {
    let seqs: Vec<_> = seqs.into_iter().collect();
    assert!(seqs.len() > 1, "{what}: {seqs:?}");
    for pair in seqs.windows(2) {
        assert_eq!(pair[1], pair[0] + 1, "{what}: {pair:?}");
    }
}

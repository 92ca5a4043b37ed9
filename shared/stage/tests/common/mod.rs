//! Joins over real shared memory: a domain of its own for each test, and what producers and stages would publish.
#![allow(dead_code, clippy::unwrap_used, reason = "parts of tests, of which each file uses some")]

pub(crate) mod building;

use std::sync::atomic::{AtomicU32, Ordering};

use evac_frames::{FrameHeader, ImuSample, Point, PoseFrame, ScanHeader, TrackingState};
use evac_ports::services::FrameService;
use evac_ports::{Bus, Domain, DomainLock, FramePublisher, RecordPublisher, now_ns};
use evac_stage::Reporter;
use evac_stage::joins::{Join, JoinOptions};

pub(crate) const MS: i64 = 1_000_000;
/// Time between two scans.
pub(crate) const PERIOD: i64 = 100 * MS;
/// A patience that no test lives to see.
pub(crate) const EVER: i64 = 3_600_000 * MS;

/// A bus in a domain of its own, which is cleaned up at the end.
pub(crate) struct Bench {
    pub(crate) bus: Bus,
    pub(crate) reporter: Reporter,
    _lock: DomainLock,
}

impl Bench {
    pub(crate) fn new() -> Self {
        static COUNTER: AtomicU32 = AtomicU32::new(0);
        let number = COUNTER.fetch_add(1, Ordering::Relaxed);
        let domain = Domain::new(&format!("join-{}-{number}", std::process::id())).unwrap();
        let lock = domain.lock().unwrap();
        let bus = Bus::join(&domain, "test").unwrap();
        let reporter = Reporter::open(&bus, "test", 0).unwrap();
        Self { bus, reporter, _lock: lock }
    }

    pub(crate) fn join<J: Join>(&self, options: JoinOptions) -> J {
        J::open(&self.bus, options).unwrap().0
    }

    pub(crate) fn records<S: evac_ports::services::RecordService>(&self) -> RecordPublisher<S> {
        RecordPublisher::open(&self.bus).unwrap()
    }

    pub(crate) fn frames<S: FrameService>(&self) -> FramePublisher<S> {
        FramePublisher::open(&self.bus).unwrap()
    }

    /// Takes in what has come and handles every complete set as the run loop does.
    pub(crate) fn handle<J: Join, R>(
        &mut self,
        join: &mut J,
        mut process: impl FnMut(J::Frame<'_>) -> R,
    ) -> Vec<R> {
        let mut results = Vec::new();
        join.take_in(&mut self.reporter).unwrap();
        while let Some(result) = join.next(&mut self.reporter, |input, _, _| process(input)) {
            results.push(result);
            join.take_in(&mut self.reporter).unwrap();
        }
        results
    }
}

/// Scan `seq` covers `[seq, seq + 1) * PERIOD`.
pub(crate) fn frame(seq: u64) -> FrameHeader {
    let start_ns = seq as i64 * PERIOD;
    let now = now_ns();
    FrameHeader {
        seq,
        start_ns,
        end_ns: start_ns + PERIOD,
        arrival_ns: now,
        sent_ns: now,
        ..FrameHeader::default()
    }
}

/// A scan of one point, whose x is the sequence number.
pub(crate) fn publish_scan<S>(port: &FramePublisher<S>, seq: u64)
where
    S: FrameService<Header = ScanHeader, Item = Point>,
{
    publish_frame(port, frame(seq));
}

pub(crate) fn publish_frame<S>(port: &FramePublisher<S>, frame: FrameHeader)
where
    S: FrameService<Header = ScanHeader, Item = Point>,
{
    let header = ScanHeader { frame, points: 1, ..ScanHeader::default() };
    port.publish(1, |_| Point::new(frame.seq as f32, 0.0, 0.0, 0, 0), || header).unwrap();
}

/// A resting sample; at 200 Hz number `seq` is at `seq * 5` ms.
pub(crate) fn sample(seq: u64, stamp_ns: i64) -> ImuSample {
    ImuSample { seq, stamp_ns, accel: [0.0, 0.0, 9.81], ..ImuSample::default() }
}

pub(crate) fn pose(seq: u64) -> PoseFrame {
    PoseFrame {
        frame: frame(seq),
        position: [0.1 * seq as f64, 0.0, 0.0],
        orientation: [0.0, 0.0, 0.0, 1.0],
        state: TrackingState::Tracking as u32,
        ..PoseFrame::default()
    }
}

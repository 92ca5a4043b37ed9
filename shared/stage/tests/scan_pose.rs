//! Deskewed scans with their poses, over real shared memory.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::time::Duration;

use common::{Bench, pose, publish_scan};
use evac_ports::services::{OdometryPose, ScanDeskewed};
use evac_ports::{FramePublisher, RecordPublisher, now_ns};
use evac_stage::joins::{Join as _, JoinOptions, ScanPoseJoin};

struct Setup {
    bench: Bench,
    scans: FramePublisher<ScanDeskewed>,
    poses: RecordPublisher<OdometryPose>,
}

impl Setup {
    fn new() -> Self {
        let bench = Bench::new();
        let (scans, poses) = (bench.frames(), bench.records());
        Self { bench, scans, poses }
    }

    fn join(&self) -> ScanPoseJoin {
        self.bench.join(JoinOptions::new(false, true))
    }

    fn scans(&self, seqs: impl IntoIterator<Item = u64>) {
        seqs.into_iter().for_each(|seq| publish_scan(&self.scans, seq));
    }

    fn poses(&self, seqs: impl IntoIterator<Item = u64>) {
        seqs.into_iter().for_each(|seq| self.poses.publish(&pose(seq)).unwrap());
    }

    /// Sequence numbers of what was handed on, each checked to be of one scan.
    fn handle(&mut self, join: &mut ScanPoseJoin) -> Vec<u64> {
        self.bench.handle(join, |input| {
            let seq = input.header.frame.seq;
            assert_eq!(input.pose.frame.seq, seq);
            assert_eq!(input.pose.position[0], 0.1 * seq as f64);
            assert_eq!(input.points[0].x as u64, seq);
            seq
        })
    }
}

#[test]
fn a_scan_waits_for_the_pose_of_its_own_number() {
    let mut setup = Setup::new();
    let mut join = setup.join();
    setup.scans(0..3);
    assert_eq!(setup.handle(&mut join), [0; 0]);
    setup.poses(0..2);
    assert_eq!(setup.handle(&mut join), [0, 1]);
    setup.poses([2]);
    assert_eq!(setup.handle(&mut join), [2]);
    let input = setup.bench.reporter.input;
    assert_eq!((input.lost, input.late), (0, 0));
}

#[test]
fn a_pose_wakes_the_mapper_and_where_its_scan_is_still_under_way_it_looks_again_soon() {
    let mut setup = Setup::new();
    let (mut join, listeners) = ScanPoseJoin::open(&setup.bench.bus, JoinOptions::new(false, true)).unwrap();
    assert_eq!(listeners.len(), 1, "a scan without its pose wakes nobody");
    setup.scans([0]);
    assert_eq!(setup.handle(&mut join), [0; 0]);
    assert_eq!(join.deadline_ns(), None);
    setup.poses([0, 1]);
    listeners[0].wait(Duration::from_secs(3600)).unwrap();
    assert_eq!(setup.handle(&mut join), [0]);
    assert!(join.deadline_ns().is_some_and(|at_ns| at_ns <= now_ns() + 16_000_000));
    // The longer it has waited the later.
    std::thread::sleep(std::time::Duration::from_millis(20));
    let before_ns = now_ns();
    assert!(join.deadline_ns().is_none_or(|at_ns| at_ns >= before_ns + 16_000_000));
    setup.scans([1]);
    assert_eq!(setup.handle(&mut join), [1]);
    assert_eq!(join.deadline_ns(), None);
}

#[test]
fn a_scan_whose_pose_was_lost_is_counted_as_late_and_the_next_ones_are_handed_on() {
    let mut setup = Setup::new();
    let mut join = setup.join();
    setup.scans(0..5);
    setup.poses([0, 3, 4]);
    assert_eq!(setup.handle(&mut join), [0, 3, 4]);
    let input = setup.bench.reporter.input;
    assert_eq!((input.lost, input.late), (0, 2));
}

#[test]
fn a_lost_scan_is_counted_and_its_pose_is_done_with() {
    let mut setup = Setup::new();
    let mut join = setup.join();
    setup.scans([0, 1, 4]);
    setup.poses(0..5);
    assert_eq!(setup.handle(&mut join), [0, 1, 4]);
    let input = setup.bench.reporter.input;
    assert_eq!((input.lost, input.late), (2, 0));
}

#[test]
fn an_odometry_that_stops_leaves_scans_that_are_counted_and_block_nobody() {
    let mut setup = Setup::new();
    let mut join = setup.join();
    for seq in 0..100 {
        setup.scans([seq]);
        assert_eq!(setup.handle(&mut join), [0; 0]);
    }
    setup.poses(90..100);
    assert_eq!(setup.handle(&mut join), (90..100).collect::<Vec<_>>());
    // The first 20 were held and the newest 32 kept for it, until poses passed them by.
    let input = setup.bench.reporter.input;
    assert_eq!((input.lost, input.late), (48, 42));
}

#[test]
fn an_odometry_that_was_behind_by_more_than_is_held_finds_every_scan() {
    let mut setup = Setup::new();
    let mut join = setup.join();
    for seq in 0..45 {
        setup.scans([seq]);
        assert_eq!(setup.handle(&mut join), [0; 0]);
    }
    setup.poses(0..30);
    let mut handled = setup.handle(&mut join);
    setup.poses(30..45);
    handled.extend(setup.handle(&mut join));
    assert_eq!(handled, (0..45).collect::<Vec<_>>());
    let input = setup.bench.reporter.input;
    assert_eq!((input.lost, input.late), (0, 0));
}

#[test]
fn a_reader_that_joins_late_gets_the_newest_sixteen_and_loses_nothing_from_there_on() {
    let mut setup = Setup::new();
    setup.scans(0..40);
    // The odometry is three scans behind.
    setup.poses(0..37);
    let mut join = setup.join();
    // A publisher hands its history over with its next frame.
    setup.scans([40]);
    setup.poses([37]);
    let first = setup.handle(&mut join);
    assert_eq!(first, (24..=37).collect::<Vec<_>>());
    setup.scans(41..50);
    setup.poses(38..50);
    assert_eq!(setup.handle(&mut join), (38..50).collect::<Vec<_>>());
    let input = setup.bench.reporter.input;
    assert_eq!((input.lost, input.late), (0, 0));
}

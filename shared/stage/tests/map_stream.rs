//! The map's stream, written by a real mapper into real shared memory: whoever reads it ends with the same map.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::building::{Copy, Mapper, walk};
use common::{Bench, pose, publish_scan};
use evac_frames::{TrackingState, map_flags};
use evac_ports::services::{OdometryPose, ScanDeskewed, TruthPose};
use evac_stage::joins::{Join as _, JoinOptions, PlanJoin, SinkJoin};

struct Setup {
    bench: Bench,
    mapper: Mapper,
}

impl Setup {
    fn new() -> Self {
        let bench = Bench::new();
        let mapper = Mapper::start(&bench.bus);
        Self { bench, mapper }
    }

    fn reader(&self) -> Reader {
        Reader { join: self.bench.join(JoinOptions::new(false, true)), copy: Copy::default() }
    }

    fn map(&mut self, seqs: impl IntoIterator<Item = u64>) {
        seqs.into_iter().for_each(|seq| self.mapper.map(seq));
    }

    fn lost(&self) -> u64 {
        self.bench.reporter.input.lost
    }
}

/// A consumer of the map.
struct Reader {
    join: PlanJoin,
    copy: Copy,
}

impl Reader {
    fn handle(&mut self, setup: &mut Setup) {
        let copy = &mut self.copy;
        setup.bench.handle(&mut self.join, |input| {
            copy.take(input.map, input.map.header.map_flags & map_flags::SNAPSHOT != 0);
        });
    }

    fn snapshots(&self) -> usize {
        self.copy.headers.iter().filter(|header| header.map_flags & map_flags::SNAPSHOT != 0).count()
    }

    /// Has the mapper's map, and every frame at most once and in order.
    #[track_caller]
    fn assert_same(&self, setup: &Setup) {
        assert!(self.copy.seqs().windows(2).all(|pair| pair[0] < pair[1]), "{:?}", self.copy.seqs());
        let expected = setup.mapper.bits();
        assert!(expected.len() > 1000, "{}", expected.len());
        assert!(self.copy.bits() == expected, "the maps differ");
    }
}

#[test]
fn a_reader_from_the_start_needs_no_snapshot() {
    let mut setup = Setup::new();
    let mut reader = setup.reader();
    for seq in 0..30 {
        setup.map([seq]);
        reader.handle(&mut setup);
    }
    assert_eq!(reader.copy.seqs(), (0..30).collect::<Vec<_>>());
    assert_eq!(reader.snapshots(), 0);
    reader.assert_same(&setup);
}

#[test]
fn a_reader_that_joins_late_ends_with_the_same_map_bit_for_bit() {
    let mut setup = Setup::new();
    let mut early = setup.reader();
    for seq in 0..31 {
        setup.map([seq]);
        early.handle(&mut setup);
    }
    let mut late = setup.reader();
    for seq in 31..60 {
        setup.map([seq]);
        early.handle(&mut setup);
        late.handle(&mut setup);
    }
    early.assert_same(&setup);
    late.assert_same(&setup);
    assert_eq!((early.snapshots(), late.snapshots()), (0, 1));
    // It asked at the first update, and the mapper answered with the next.
    assert_eq!(late.copy.seqs(), (32..60).collect::<Vec<_>>());
    assert_eq!(setup.lost(), 0);
}

#[test]
fn a_reader_that_missed_key_frames_asks_again_and_ends_with_the_same_map() {
    let mut setup = Setup::new();
    let mut reader = setup.reader();
    setup.map(0..10);
    reader.handle(&mut setup);
    // It stalls, and 32 are kept for it.
    setup.map(10..60);
    reader.handle(&mut setup);
    assert_eq!(reader.copy.seqs(), (0..10).collect::<Vec<_>>());
    assert!(reader.join.waits());
    for seq in 60..70 {
        setup.map([seq]);
        reader.handle(&mut setup);
    }
    assert!(!reader.join.waits());
    reader.assert_same(&setup);
    assert_eq!(reader.snapshots(), 1);
    // The changes of these are in the snapshot, and their frames are handed on before it.
    assert_eq!(reader.copy.seqs()[10..], (28..70).collect::<Vec<_>>());
    assert_eq!(setup.lost(), 18);
}

#[test]
fn another_reader_s_old_snapshot_is_not_taken_where_updates_are_missing_after_it() {
    let mut setup = Setup::new();
    let mut slow = setup.reader();
    setup.map(0..10);
    slow.handle(&mut setup);
    // Another reader joins late and gets its snapshot, which waits for the slow one, too.
    let mut other = setup.reader();
    setup.map([10]);
    other.handle(&mut setup);
    setup.map([11]);
    other.handle(&mut setup);
    assert_eq!(other.snapshots(), 1);
    // The slow one holds only the last 20 of these: between the old snapshot and them key frames are missing.
    setup.map(12..60);
    slow.handle(&mut setup);
    assert_eq!(slow.snapshots(), 0, "a snapshot that does not join is not taken");
    setup.map([60, 61]);
    slow.handle(&mut setup);
    assert_eq!(slow.snapshots(), 1);
    slow.assert_same(&setup);
}

#[test]
fn of_more_updates_than_are_held_until_a_snapshot_comes_no_frame_is_left_out() {
    let mut setup = Setup::new();
    let mut slow = setup.reader();
    setup.map(0..10);
    slow.handle(&mut setup);
    // Another reader gets a snapshot of the map after frame 24.
    setup.map(10..23);
    let mut other = setup.reader();
    setup.map([23]);
    other.handle(&mut setup);
    setup.map([24]);
    // The slow one misses a key frame, 12. Of the 32 updates that are kept for it it holds those from 26 on; 25 is no key frame.
    setup.map(25..46);
    slow.handle(&mut setup);
    assert_eq!(slow.copy.seqs(), (0..10).chain(14..46).collect::<Vec<_>>());
    assert_eq!((slow.snapshots(), setup.lost()), (1, 4));
    slow.assert_same(&setup);
}

#[test]
fn a_burst_of_more_updates_than_are_held_reaches_a_reader_whole_and_without_a_snapshot() {
    let mut setup = Setup::new();
    let mut reader = setup.reader();
    setup.map(0..10);
    reader.handle(&mut setup);
    setup.map(10..40);
    reader.handle(&mut setup);
    assert_eq!(reader.copy.seqs(), (0..40).collect::<Vec<_>>());
    assert_eq!((reader.snapshots(), setup.lost()), (0, 0));
    reader.assert_same(&setup);
}

#[test]
fn a_reader_that_missed_only_scans_that_are_no_key_frames_goes_on_without_a_snapshot() {
    let mut setup = Setup::new();
    let mut reader = setup.reader();
    setup.map(0..4);
    reader.handle(&mut setup);
    // Key frames are 0, 3, 6; 4 and 5 never come.
    setup.map([6, 7]);
    reader.handle(&mut setup);
    assert_eq!(reader.copy.seqs(), [0, 1, 2, 3, 6, 7]);
    assert_eq!((reader.snapshots(), setup.lost()), (0, 2));
    reader.assert_same(&setup);
}

#[test]
fn a_request_is_answered_when_no_scan_comes_any_more() {
    let mut setup = Setup::new();
    setup.map(0..9);
    let mut late = setup.reader();
    setup.map([9]);
    late.handle(&mut setup);
    assert_eq!(late.copy.headers.len(), 0);
    setup.mapper.idle();
    late.handle(&mut setup);
    late.assert_same(&setup);
    setup.mapper.idle();
    late.handle(&mut setup);
    assert_eq!((late.copy.seqs(), late.snapshots()), (vec![9], 1));
}

#[test]
fn a_mapper_that_starts_anew_replaces_the_map_and_a_lost_request_is_made_again() {
    let mut setup = Setup::new();
    let mut reader = setup.reader();
    setup.map(0..10);
    reader.handle(&mut setup);
    // The mapper ends while a reader waits for its answer; the next one begins with an empty map.
    setup.map(10..50);
    reader.handle(&mut setup);
    setup.mapper = Mapper::start_as(&setup.bench.bus, 1);
    for seq in 50..80 {
        setup.map([seq]);
        reader.handle(&mut setup);
    }
    reader.assert_same(&setup);
    assert_eq!(reader.copy.headers.last().unwrap().frame.epoch, 1);
}

#[test]
fn plan_input_has_the_pose_of_the_update_s_scan_or_says_that_there_is_none() {
    let mut setup = Setup::new();
    let mut join: PlanJoin = setup.bench.join(JoinOptions::new(false, true));
    let poses = setup.bench.records::<OdometryPose>();
    for seq in [0, 1, 3] {
        poses.publish(&walk(seq)).unwrap();
    }
    setup.map(0..4);
    let seen = setup.bench.handle(&mut join, |input| {
        assert_eq!(input.pose.position, walk(input.map.header.frame.seq).position);
        (input.pose.frame.seq, input.pose.orientation, input.pose.state)
    });
    let here = ([0.0, 0.0, 0.0, 1.0], TrackingState::Tracking as u32);
    let absent = ([0.0; 4], TrackingState::Lost as u32);
    let expected: Vec<_> =
        [here, here, absent, here].iter().enumerate().map(|(k, (q, state))| (k as u64, *q, *state)).collect();
    assert_eq!(seen, expected);
    assert_eq!(setup.bench.reporter.input.late, 1);
}

/// Number, points, x of the first point, x of the pose, x of the truth.
type SinkSeen = (u64, usize, Option<f32>, f64, Option<f64>);

fn sink_seen(setup: &mut Setup, join: &mut SinkJoin) -> Vec<SinkSeen> {
    setup.bench.handle(join, |input| {
        let seq = input.map.header.frame.seq;
        assert_eq!((input.header.frame.seq, input.pose.frame.seq), (seq, seq));
        let x = input.points.first().map(|point| point.x);
        (seq, input.points.len(), x, input.pose.position[0], input.truth.map(|truth| truth.position[0]))
    })
}

#[test]
fn scan_pose_map_and_truth_of_one_number_come_together() {
    let mut setup = Setup::new();
    let mut join: SinkJoin = setup.bench.join(JoinOptions::new(false, true));
    let (scans, poses) = (setup.bench.frames::<ScanDeskewed>(), setup.bench.records::<OdometryPose>());
    let truth = setup.bench.records::<TruthPose>();
    // Truth runs ahead, the mapper is behind.
    for seq in 0..8 {
        let mut pose = pose(seq);
        pose.position[0] += 0.001;
        truth.publish(&pose).unwrap();
    }
    (0..6).for_each(|seq| publish_scan(&scans, seq));
    (0..5).for_each(|seq| poses.publish(&walk(seq)).unwrap());
    setup.map(0..4);
    let mut seen = sink_seen(&mut setup, &mut join);
    setup.map([4]);
    seen.extend(sink_seen(&mut setup, &mut join));
    let x = |seq: u64| 0.1 * seq as f64;
    let expected: Vec<SinkSeen> =
        (0..5).map(|seq| (seq, 1, Some(seq as f32), x(seq), Some(x(seq) + 0.001))).collect();
    assert_eq!(seen, expected);
    let input = setup.bench.reporter.input;
    assert_eq!((input.lost, input.late), (0, 0));
}

#[test]
fn updates_of_a_mapper_that_was_behind_find_their_scans_and_poses() {
    let mut setup = Setup::new();
    let mut join: SinkJoin = setup.bench.join(JoinOptions::new(false, true));
    let (scans, poses) = (setup.bench.frames::<ScanDeskewed>(), setup.bench.records::<OdometryPose>());
    for seq in 0..45 {
        publish_scan(&scans, seq);
        poses.publish(&walk(seq)).unwrap();
        assert_eq!(sink_seen(&mut setup, &mut join), []);
    }
    // The mapper itself has lost frames 3 to 8.
    setup.map(0..3);
    setup.map(9..30);
    let mut seen = sink_seen(&mut setup, &mut join);
    setup.map(30..45);
    seen.extend(sink_seen(&mut setup, &mut join));
    let seqs: Vec<_> = seen.iter().map(|(seq, ..)| *seq).collect();
    assert_eq!(seqs, (0..3).chain(9..45).collect::<Vec<_>>());
    assert!(seen.iter().all(|(_, points, ..)| *points == 1), "{seen:?}");
    let input = setup.bench.reporter.input;
    assert_eq!((input.lost, input.late), (6, 0));
}

#[test]
fn a_sink_that_goes_on_from_a_journal_finds_the_scans_before_the_first_update_that_it_heard() {
    let mut setup = Setup::new();
    let (scans, poses) = (setup.bench.frames::<ScanDeskewed>(), setup.bench.records::<OdometryPose>());
    let step = |setup: &mut Setup, seq: u64| {
        publish_scan(&scans, seq);
        poses.publish(&walk(seq)).unwrap();
        setup.map([seq]);
    };
    (0..9).for_each(|seq| step(&mut setup, seq));
    // It was started in the place of one that had written down frames up to 4, and hears an update before it is told to lead.
    let mut join: SinkJoin = setup.bench.join(JoinOptions::new(true, true));
    step(&mut setup, 9);
    join.take_in(&mut setup.bench.reporter).unwrap();
    join.resume(Some(4));
    join.take_in(&mut setup.bench.reporter).unwrap();
    setup.mapper.idle();
    let seen = sink_seen(&mut setup, &mut join);
    let seqs: Vec<_> = seen.iter().map(|(seq, ..)| *seq).collect();
    // The last one with the snapshot once more.
    assert_eq!(seqs, [5, 6, 7, 8, 9, 9]);
    assert!(seen[..5].iter().all(|(seq, points, x, ..)| (*points, *x) == (1, Some(*seq as f32))), "{seen:?}");
    assert_eq!(setup.bench.reporter.input.late, 0);
}

#[test]
fn without_a_simulator_there_is_no_truth_and_a_missing_scan_is_counted() {
    let mut setup = Setup::new();
    let mut join: SinkJoin = setup.bench.join(JoinOptions::new(false, true));
    let (scans, poses) = (setup.bench.frames::<ScanDeskewed>(), setup.bench.records::<OdometryPose>());
    [0, 2].into_iter().for_each(|seq| publish_scan(&scans, seq));
    (0..3).for_each(|seq| poses.publish(&walk(seq)).unwrap());
    setup.map(0..3);
    let seen = sink_seen(&mut setup, &mut join);
    assert_eq!(seen, [(0, 1, Some(0.0), 0.0, None), (1, 0, None, 0.1, None), (2, 1, Some(2.0), 0.2, None)]);
    assert_eq!(setup.bench.reporter.input.late, 1);
}

//! Scans with the IMU samples that cover them, over real shared memory.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{Bench, EVER, MS, frame, pose, publish_frame, publish_scan, sample};
use evac_frames::{FrameHeader, frame_flags};
use evac_ports::services::{Imu, LidarScan, OdometryPose, ScanDeskewed};
use evac_ports::{FramePublisher, RecordPublisher};
use evac_stage::ScanWithImu;
use evac_stage::joins::{DeskewedScanWithImu, Join, JoinOptions, RawScanWithImu};

/// Live, and a scan waits for ever.
const PATIENT: JoinOptions = JoinOptions { lossless: false, has_odometry: false, patience_ns: EVER };

struct Setup {
    bench: Bench,
    join: RawScanWithImu,
    scans: FramePublisher<LidarScan>,
    imu: RecordPublisher<Imu>,
}

/// What a stage was called with.
#[derive(Debug, PartialEq)]
struct Seen {
    seq: u64,
    stamps_ms: Vec<i64>,
    covers: bool,
    prior: Option<u64>,
}

fn seen(input: ScanWithImu<'_>) -> Seen {
    assert_eq!(input.points.len(), 1);
    assert_eq!(input.points[0].x as u64, input.header.frame.seq);
    Seen {
        seq: input.header.frame.seq,
        stamps_ms: input.imu.iter().map(|sample| sample.stamp_ns / MS).collect(),
        covers: input.imu_covers,
        prior: input.prior.map(|prior| prior.frame.seq),
    }
}

impl Setup {
    fn new(options: JoinOptions) -> Self {
        let bench = Bench::new();
        let (join, scans, imu) = (bench.join(options), bench.frames(), bench.records());
        Self { bench, join, scans, imu }
    }

    /// Samples at 200 Hz; number k is at 5 k ms.
    fn imu(&self, numbers: std::ops::RangeInclusive<u64>) {
        for k in numbers {
            self.imu.publish(&sample(k, k as i64 * 5 * MS)).unwrap();
        }
    }

    fn handle(&mut self) -> Vec<Seen> {
        self.bench.handle(&mut self.join, seen)
    }
}

fn every_5_ms(from: i64, to: i64) -> Vec<i64> {
    (from..=to).step_by(5).collect()
}

#[test]
fn a_scan_waits_until_the_imu_covers_it_to_its_end() {
    let mut setup = Setup::new(PATIENT);
    publish_scan(&setup.scans, 0);
    setup.imu(0..=19);
    assert_eq!(setup.handle(), []);
    setup.imu(20..=20);
    let whole = Seen { seq: 0, stamps_ms: every_5_ms(0, 100), covers: true, prior: None };
    assert_eq!(setup.handle(), [whole]);
    assert_eq!(setup.bench.reporter.input.late, 0);
}

#[test]
fn samples_go_from_the_previous_end_to_the_first_after_this_end_and_overlap_at_the_border() {
    let mut setup = Setup::new(PATIENT);
    // 7 ms apart, so that no sample is at a border of 100, 200 or 300 ms.
    for k in 0..=60 {
        setup.imu.publish(&sample(k, k as i64 * 7 * MS - 20 * MS)).unwrap();
    }
    (0..3).for_each(|seq| publish_scan(&setup.scans, seq));
    let calls = setup.handle();
    let borders: Vec<_> = calls.iter().map(|c| (c.stamps_ms[0], *c.stamps_ms.last().unwrap())).collect();
    // The first frame gets all that came before.
    assert_eq!(borders, [(-20, 106), (99, 204), (197, 302)]);
    assert!(calls.iter().all(|call| call.stamps_ms.windows(2).all(|pair| pair[1] - pair[0] == 7)));
}

#[test]
fn a_scan_that_overlaps_the_one_before_gets_the_samples_from_its_own_start_again() {
    let mut setup = Setup::new(PATIENT);
    setup.imu(0..=60);
    publish_scan(&setup.scans, 0);
    publish_frame(&setup.scans, FrameHeader { start_ns: 70 * MS, end_ns: 170 * MS, ..frame(1) });
    let calls = setup.handle();
    assert_eq!(calls[1].stamps_ms, every_5_ms(70, 170));
}

#[test]
fn samples_over_a_lost_scan_come_with_the_next_one() {
    let mut setup = Setup::new(PATIENT);
    setup.imu(0..=80);
    for seq in [0, 3] {
        publish_scan(&setup.scans, seq);
    }
    let calls = setup.handle();
    assert_eq!(calls[1], Seen { seq: 3, stamps_ms: every_5_ms(100, 400), covers: true, prior: None });
    assert_eq!(setup.bench.reporter.input.lost, 2);
}

#[test]
fn when_the_imu_stops_a_scan_is_handed_on_as_not_covered_and_counted_as_late() {
    let mut setup = Setup::new(JoinOptions { patience_ns: 20 * MS, ..PATIENT });
    setup.imu(0..=30);
    (0..2).for_each(|seq| publish_scan(&setup.scans, seq));
    let mut calls = setup.handle();
    assert_eq!(calls.len(), 1, "the second scan waits: {calls:?}");
    while calls.len() < 2 {
        assert!(setup.join.deadline_ns().is_some(), "the run loop is told when to look again");
        std::thread::sleep(std::time::Duration::from_millis(1));
        calls.extend(setup.handle());
    }
    assert!(calls[0].covers);
    assert_eq!(calls[1], Seen { seq: 1, stamps_ms: every_5_ms(100, 150), covers: false, prior: None });
    assert_eq!(setup.bench.reporter.input.late, 1);
    assert_eq!(setup.join.deadline_ns(), None);
}

#[test]
fn the_end_of_the_imu_s_stream_covers_every_scan_that_follows() {
    let mut setup = Setup::new(PATIENT);
    setup.imu(0..=30);
    (0..3).for_each(|seq| publish_scan(&setup.scans, seq));
    assert_eq!(setup.handle().len(), 1);
    let mut end = sample(31, 150 * MS);
    end.flags = frame_flags::END_OF_STREAM;
    setup.imu.publish(&end).unwrap();
    let calls = setup.handle();
    assert_eq!(calls.iter().map(|call| (call.seq, call.covers)).collect::<Vec<_>>(), [(1, true), (2, true)]);
    // The mark is a copy of the last sample, not a measurement.
    assert_eq!(calls[0].stamps_ms, every_5_ms(100, 150));
    let input = setup.bench.reporter.input;
    assert_eq!((input.late, input.imu_lost, input.imu_rejected), (0, 0, 0));
}

#[test]
fn samples_that_are_not_finite_out_of_order_or_doubled_are_dropped_and_counted() {
    let mut setup = Setup::new(PATIENT);
    setup.imu(0..=9);
    let mut not_finite = sample(10, 50 * MS);
    not_finite.gyro[1] = f64::NAN;
    setup.imu.publish(&not_finite).unwrap();
    let mut infinite = sample(11, 55 * MS);
    infinite.accel[2] = f64::INFINITY;
    setup.imu.publish(&infinite).unwrap();
    // Out of order in time; then a number that was there before.
    setup.imu.publish(&sample(12, 30 * MS)).unwrap();
    setup.imu.publish(&sample(12, 60 * MS)).unwrap();
    setup.imu(13..=25);
    publish_scan(&setup.scans, 0);
    let calls = setup.handle();
    let expected: Vec<_> = (0..=9).chain(13..=20).map(|k| k * 5).collect();
    assert_eq!(calls[0].stamps_ms, expected);
    let input = setup.bench.reporter.input;
    assert_eq!((input.imu_rejected, input.imu_lost), (4, 0));
}

#[test]
fn gaps_in_the_numbers_of_scans_and_samples_are_counted_as_lost() {
    let mut setup = Setup::new(PATIENT);
    setup.imu(5..=10);
    setup.imu(14..=200);
    for seq in [3, 4, 7, 7, 6, 8] {
        publish_scan(&setup.scans, seq);
    }
    let seqs: Vec<_> = setup.handle().iter().map(|call| call.seq).collect();
    assert_eq!(seqs, [3, 4, 7, 8]);
    let input = setup.bench.reporter.input;
    // What came before the first is not missed; what comes twice or afterwards is late.
    assert_eq!((input.lost, input.imu_lost, input.late), (2, 3, 2));
}

#[test]
fn a_clock_that_was_set_back_is_followed_after_some_samples() {
    let mut setup = Setup::new(PATIENT);
    for k in 0..=20 {
        setup.imu.publish(&sample(k, 1_000_000 * MS + k as i64 * 5 * MS)).unwrap();
    }
    for k in 21..=300 {
        setup.imu.publish(&sample(k, (k as i64 - 21) * 5 * MS)).unwrap();
    }
    publish_scan(&setup.scans, 9);
    let calls = setup.handle();
    assert_eq!(calls[0].stamps_ms, every_5_ms(200, 1000));
    assert_eq!(setup.bench.reporter.input.imu_rejected, 40);
}

#[test]
fn lossless_waits_for_the_pose_of_exactly_the_scan_before() {
    let mut setup = Setup::new(JoinOptions { lossless: true, has_odometry: true, patience_ns: EVER });
    let poses = setup.bench.records::<OdometryPose>();
    setup.imu(0..=100);
    (0..4).for_each(|seq| publish_scan(&setup.scans, seq));
    let priors = |calls: Vec<Seen>| calls.iter().map(|call| (call.seq, call.prior)).collect::<Vec<_>>();
    assert_eq!(priors(setup.handle()), [(0, None)]);
    assert_eq!(priors(setup.handle()), []);
    for seq in 0..3 {
        poses.publish(&pose(seq)).unwrap();
        assert_eq!(priors(setup.handle()), [(seq + 1, Some(seq))]);
    }
}

#[test]
fn live_a_scan_takes_the_newest_pose_and_does_not_wait_for_one() {
    let mut setup = Setup::new(JoinOptions { has_odometry: true, ..PATIENT });
    let poses = setup.bench.records::<OdometryPose>();
    setup.imu(0..=100);
    for (seq, newest) in [(0, None), (1, None), (2, Some(0)), (3, Some(2))] {
        if let Some(newest) = newest {
            poses.publish(&pose(newest)).unwrap();
        }
        publish_scan(&setup.scans, seq);
        assert_eq!(setup.handle()[0].prior, newest);
    }
}

#[test]
fn the_odometry_gets_no_prior_and_does_not_wait_for_its_own_poses() {
    let mut bench = Bench::new();
    let options = JoinOptions { lossless: true, has_odometry: true, patience_ns: EVER };
    let mut join: DeskewedScanWithImu = bench.join(options);
    let (scans, imu, poses) = (bench.frames::<ScanDeskewed>(), bench.records::<Imu>(), bench.records());
    RecordPublisher::<OdometryPose>::publish(&poses, &pose(0)).unwrap();
    (0..=100).for_each(|k| imu.publish(&sample(k, k as i64 * 5 * MS)).unwrap());
    (0..3).for_each(|seq| publish_scan(&scans, seq));
    let calls = bench.handle(&mut join, seen);
    assert_eq!(calls.iter().map(|call| call.prior).collect::<Vec<_>>(), [None; 3]);
}

#[test]
fn of_scans_that_wait_too_many_at_once_the_first_and_the_newest_stay_and_the_others_are_counted() {
    let mut setup = Setup::new(PATIENT);
    for seq in 0..70 {
        publish_scan(&setup.scans, seq);
        assert_eq!(setup.handle(), []);
    }
    for k in 0..=1500 {
        setup.imu.publish(&sample(k, k as i64 * 5 * MS)).unwrap();
    }
    let seqs: Vec<_> = setup.handle().iter().map(|call| call.seq).collect();
    assert_eq!(seqs, (0..20).chain(38..70).collect::<Vec<_>>());
    assert_eq!(setup.bench.reporter.input.lost, 18);
}

#[test]
fn a_lidar_that_is_silent_for_a_minute_leaves_the_newest_samples_and_a_count_of_the_others() {
    let mut setup = Setup::new(PATIENT);
    setup.imu(0..=20);
    publish_scan(&setup.scans, 0);
    assert_eq!(setup.handle().len(), 1);
    for k in 21..=12_000 {
        setup.imu(k..=k);
        if k % 1000 == 0 {
            assert_eq!(setup.handle(), []);
        }
    }
    publish_frame(&setup.scans, FrameHeader { start_ns: 59_900 * MS, end_ns: 60_000 * MS, ..frame(1) });
    let calls = setup.handle();
    let kept = calls[0].stamps_ms.len() as u64;
    assert!((2048..=4096).contains(&kept), "{kept}");
    assert_eq!(calls[0].stamps_ms.last(), Some(&60_000));
    assert_eq!(setup.bench.reporter.input.imu_lost, 12_001 - kept);
}

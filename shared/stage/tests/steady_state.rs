//! Joining takes no memory after warm-up. Publishing takes one small allocation, inside the middleware: iceoryx2 0.10 keeps
//! the handle of every loan in a reference-counted box of its own.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::building::walk;
use common::{Bench, EVER, MS, pose, publish_scan, sample};
use evac_frames::{MapHeader, map_flags};
use evac_ports::FrameSubscriber;
use evac_ports::services::{Imu, LidarScan, MapUpdate, OdometryPose, ScanDeskewed};
use evac_stage::joins::{Join, JoinOptions, PlanJoin, RawScanWithImu, ScanPoseJoin, SinkJoin};
use evac_testkit::{CountingAllocator, count_allocations};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

const OPTIONS: JoinOptions = JoinOptions { lossless: false, has_odometry: true, patience_ns: EVER };
/// What the middleware allocates for one message.
const LOAN: u64 = 1;
/// Frames after which every buffer has its size.
const WARM_UP: u64 = 100;
const FRAMES: u64 = 400;

/// Asserts that, after warm-up, joining (taking in, handing on, reporting) allocates nothing, and publishing `messages` a
/// frame no more than the middleware does.
#[track_caller]
fn assert_steady<J: Join>(messages: u64, mut publish: impl FnMut(u64), bench: &mut Bench, join: &mut J) {
    let (mut joining, mut publishing, mut handled) = (0, 0, 0);
    for seq in 0..FRAMES {
        let published = count_allocations(|| publish(seq));
        let joined = count_allocations(|| {
            join.take_in(&mut bench.reporter).unwrap();
            while let Some(()) = join.next(&mut bench.reporter, |_, frame, reporter| {
                reporter.begin();
                reporter.done(frame, frame.arrival_ns);
                handled += 1;
            }) {
                join.take_in(&mut bench.reporter).unwrap();
            }
            bench.reporter.report_if_due().unwrap();
        });
        if seq >= WARM_UP {
            (joining, publishing) = (joining + joined, publishing + published);
        }
    }
    assert_eq!(handled, FRAMES);
    assert_eq!(joining, 0);
    assert!(publishing <= messages * LOAN * (FRAMES - WARM_UP), "{publishing} by publishing");
}

#[test]
fn receiving_allocates_nothing_and_publishing_no_more_than_the_loan_s_handle() {
    let bench = Bench::new();
    let (subscriber, _listener) = FrameSubscriber::<LidarScan>::open(&bench.bus).unwrap();
    let publisher = bench.frames::<LidarScan>();
    let (mut publishing, mut receiving) = (0, 0);
    for seq in 0..FRAMES {
        let published = count_allocations(|| publish_scan(&publisher, seq));
        let received = count_allocations(|| while subscriber.receive().unwrap().is_some() {});
        if seq >= WARM_UP {
            (publishing, receiving) = (publishing + published, receiving + received);
        }
    }
    assert_eq!(receiving, 0);
    assert!(publishing <= LOAN * (FRAMES - WARM_UP), "{publishing}");
}

#[test]
fn joining_scans_with_imu_and_pose_allocates_nothing() {
    let mut bench = Bench::new();
    let mut join: RawScanWithImu = bench.join(OPTIONS);
    let (scans, imu, poses) =
        (bench.frames::<LidarScan>(), bench.records::<Imu>(), bench.records::<OdometryPose>());
    imu.publish(&sample(0, 0)).unwrap();
    let publish = |seq: u64| {
        publish_scan(&scans, seq);
        for k in seq * 20 + 1..=seq * 20 + 20 {
            imu.publish(&sample(k, k as i64 * 5 * MS)).unwrap();
        }
        poses.publish(&pose(seq)).unwrap();
    };
    assert_steady(22, publish, &mut bench, &mut join);
}

#[test]
fn joining_scans_with_poses_allocates_nothing() {
    let mut bench = Bench::new();
    let mut join: ScanPoseJoin = bench.join(OPTIONS);
    let (scans, poses) = (bench.frames::<ScanDeskewed>(), bench.records::<OdometryPose>());
    let publish = |seq: u64| {
        publish_scan(&scans, seq);
        poses.publish(&pose(seq)).unwrap();
    };
    assert_steady(2, publish, &mut bench, &mut join);
}

#[test]
fn joining_the_map_with_everything_else_allocates_nothing() {
    let mut bench = Bench::new();
    let mut sink: SinkJoin = bench.join(OPTIONS);
    let (scans, poses) = (bench.frames::<ScanDeskewed>(), bench.records::<OdometryPose>());
    let updates = bench.frames::<MapUpdate>();
    let publish = |seq: u64| {
        publish_scan(&scans, seq);
        poses.publish(&walk(seq)).unwrap();
        let header = update(seq);
        updates.publish(100, |_| evac_frames::Voxel::default(), || header).unwrap();
    };
    assert_steady(3, publish, &mut bench, &mut sink);
    let mut bench = Bench::new();
    let mut plan: PlanJoin = bench.join(OPTIONS);
    let (updates, poses) = (bench.frames::<MapUpdate>(), bench.records::<OdometryPose>());
    let publish = |seq: u64| {
        poses.publish(&walk(seq)).unwrap();
        updates.publish(100, |_| evac_frames::Voxel::default(), || update(seq)).unwrap();
    };
    assert_steady(2, publish, &mut bench, &mut plan);
}

/// Every scan is a key frame.
fn update(seq: u64) -> MapHeader {
    MapHeader {
        frame: common::frame(seq),
        key_frames: seq + 1,
        map_flags: map_flags::KEY_FRAME,
        resolution: 0.1,
        ..MapHeader::default()
    }
}

//! What a frame costs once everything has been used once.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

use evac_frames::{FrameHeader, ImuSample, Point, PoseFrame, ScanHeader};
use evac_recorder::{Recorder, RecorderConfig};
use evac_stage::{Counters, NoOutput, Rig, Stage as _, Tapped};
use evac_testkit::{CountingAllocator, count_allocations};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// A tenth of a second: a scan in both forms, 20 IMU samples and a pose.
fn record(recorder: &mut Recorder, tenth: u64, points: &[Point]) {
    let time = tenth as i64 * 100_000_000;
    let frame =
        FrameHeader { seq: tenth, start_ns: time, end_ns: time + 100_000_000, ..FrameHeader::default() };
    let header = ScanHeader { frame, points: points.len() as u32, ..ScanHeader::default() };
    let mut process = |tapped: Tapped<'_>| {
        recorder.process(tapped, &mut NoOutput, &mut Counters::default()).unwrap();
    };
    for k in 0..20 {
        process(Tapped::Imu(&ImuSample { stamp_ns: time + k * 5_000_000, ..ImuSample::default() }));
    }
    process(Tapped::Scan(&header, points));
    process(Tapped::Deskewed(&header, points));
    process(Tapped::Pose(&PoseFrame { frame, ..PoseFrame::default() }));
}

#[test]
fn a_frame_costs_no_allocation_and_a_chunk_only_its_index() {
    let folder = tempfile::tempdir().unwrap();
    let config = RecorderConfig { output_dir: folder.path().to_owned(), ..RecorderConfig::default() };
    let mut recorder = Recorder::new(config, &Rig::default()).unwrap();
    recorder.begin("").unwrap();
    let points = vec![Point::new(1.0, 2.0, 3.0, 50, 7); 10_000];
    for tenth in 0..100 {
        record(&mut recorder, tenth, &points);
    }
    let counts: Vec<_> =
        (100..300).map(|tenth| count_allocations(|| record(&mut recorder, tenth, &points))).collect();
    println!("allocations of each tenth of a second: {counts:?}");
    // A chunk is full after six of them; its index has an entry for each message.
    let without = counts.iter().filter(|count| **count == 0).count();
    recorder.finish().unwrap();
    let file = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path().join("evac_0.mcap");
    let size = std::fs::metadata(file).unwrap().len();
    // Per scan: 160 kB raw and 200 kB for ROS, twice.
    assert!(size > 300 * 2 * 360_000, "{size} bytes");
    assert!(counts.iter().all(|count| *count < 60), "{counts:?}");
    assert!(without > 0, "{counts:?}");
}

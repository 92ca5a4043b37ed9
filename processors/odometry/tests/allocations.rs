//! After warm-up the odometry does not touch the heap, not even where its map grows.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic as the test may")]

mod common;

use common::Odometry;
use common::room::{Room, glide};
use evac_frames::scan_flags;
use evac_geometry::nalgebra::Vector3;
use evac_odometry::{Lio, Loam};
use evac_stage::{Counters, PoseOutput, Rig};
use evac_testkit::{CountingAllocator, count_allocations};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn lio_allocates_in_no_frame_neither_at_the_start_nor_on_new_ground_nor_after_a_loss() {
    assert_no_allocation::<Lio>(true);
}

#[test]
fn loam_allocates_in_no_frame_neither_at_the_start_nor_on_new_ground_nor_after_a_loss() {
    assert_no_allocation::<Loam>(true);
    assert_no_allocation::<Loam>(false);
}

fn assert_no_allocation<S: Odometry>(deskewed: bool) {
    let room = Room { max: Vector3::new(14.0, 3.0, 1.8), people: 1, ..Room::new(31) };
    let mut frames = room.frames(14.0, glide(Vector3::new(6.0, 0.0, 0.0), 0.4, 9.0));
    for sample in frames[60..63].iter_mut().flat_map(|frame| frame.imu.iter_mut()) {
        sample.accel[1] += 80.0;
    }
    for point in frames[80..90].iter_mut().flat_map(|frame| frame.points.iter_mut()) {
        *point = point.moved_to(point.x * 0.7, point.y * 0.7, point.z * 0.7);
    }
    let mut odometry = S::new(S::Config::default(), &Rig::default()).unwrap();
    let mut counters = Counters::default();
    let mut output = PoseOutput::newest_only();
    let mut allocations = 0;
    for (seq, frame) in frames.iter_mut().enumerate() {
        frame.header.scan_flags |= if deskewed { scan_flags::DESKEWED } else { 0 };
        let input = frame.input();
        let made = count_allocations(|| odometry.process(input, &mut output, &mut counters).unwrap());
        // The first frame makes the output's own buffer.
        allocations += if seq > 0 { made } else { 0 };
    }
    assert_eq!(allocations, 0);
    assert!(odometry.losses() > 0, "{}", odometry.said());
}

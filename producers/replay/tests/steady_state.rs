//! A replay of packets takes no memory after its first scans.

mod common;

use common::{open, walk};
use evac_stage::{SensorEvent, Source};
use evac_testkit::{CountingAllocator, count_allocations};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn scans_after_the_third_are_replayed_without_an_allocation() {
    let Some(config) = walk("shake") else { return };
    let mut replay = open(config);
    let (mut scans, mut allocations, mut sum) = (0, 0, 0.0);
    loop {
        let mut event = None;
        let count = count_allocations(|| event = replay.next_event().unwrap());
        let Some(event) = event else { break };
        if scans > 3 {
            allocations += count;
        }
        if let SensorEvent::Scan(header) = event {
            scans += 1;
            allocations += count_allocations(|| {
                sum += (0..header.points as usize).map(|index| replay.point(index).x).sum::<f32>();
            });
        }
    }
    assert_eq!(scans, 213);
    assert_eq!(allocations, 0);
    assert!(sum > 0.0);
}

//! No allocation while mapping what is already in the map.

mod common;

use common::{feed, mapper, pose, scan};
use evac_octree_mapper::{KeyFrameConfig, OctreeMapperConfig};
use evac_stage::{Counters, MapOutput};
use evac_testkit::{CountingAllocator, count_allocations};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn key_frames_of_a_known_place_allocate_nothing_while_its_values_move() {
    let every_scan = KeyFrameConfig { distance_m: 0.0, angle_deg: 0.0, interval_s: 0.0 };
    let config = OctreeMapperConfig { key_frames: every_scan, ..Default::default() };
    let mut mapper = mapper(config);
    let (mut output, mut counters) = (MapOutput::newest_only(), Counters::default());
    // Six places by turns; noise and pattern are other ones in every scan.
    let place = |seq: u64| pose(0.1 * (seq % 6) as f64, 3.0 * (seq % 6) as f64);
    let (mut scans_without_new_bricks, mut changed, mut most_changed) = (0, 0, 0);
    for seq in 0..300 {
        let scan = scan(seq, &place(seq));
        let bricks = mapper.map().bricks();
        let allocations = count_allocations(|| feed(&mut mapper, &scan, &mut output, &mut counters));
        // The list that stands for the update in shared memory grows with the largest.
        let larger_update = mapper.map().changed() > most_changed;
        most_changed = most_changed.max(mapper.map().changed());
        if seq >= 60 && mapper.map().bricks() == bricks && !larger_update {
            assert_eq!(allocations, 0, "scan {seq}");
            scans_without_new_bricks += 1;
            changed += mapper.map().changed();
        }
    }
    assert!(scans_without_new_bricks > 60, "{scans_without_new_bricks}");
    assert!(changed / scans_without_new_bricks > 1000, "the measured scans did change the map");
    assert_eq!(output.memory[0].0.key_frames, 300);
}

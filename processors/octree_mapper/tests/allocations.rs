//! Hardly any allocation while mapping what is already in the map.

mod common;

use common::{feed, mapper, pose, scan};
use evac_octree_mapper::{KeyFrameConfig, OctreeMapperConfig};
use evac_stage::{Counters, MapOutput};
use evac_testkit::{CountingAllocator, count_allocations};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn a_key_frame_of_a_known_place_allocates_no_more_than_a_few_pages() {
    let every_scan = KeyFrameConfig { distance_m: 0.0, angle_deg: 0.0, interval_s: 0.0 };
    let config = OctreeMapperConfig { key_frames: every_scan, ..Default::default() };
    let mut mapper = mapper(config);
    let (mut output, mut counters) = (MapOutput::newest_only(), Counters::default());
    let scans: Vec<_> = (0..6).map(|seq| scan(seq, &pose(0.1 * seq as f64, 3.0 * seq as f64))).collect();
    for scan in &scans {
        feed(&mut mapper, scan, &mut output, &mut counters);
    }
    for scan in &scans {
        let allocations = count_allocations(|| feed(&mut mapper, scan, &mut output, &mut counters));
        // Bricks in which new values occur grow: each of the map's eight stores may need a page more and its list of pages.
        assert!(allocations <= 16, "scan {}: {allocations}", scan.0.frame.seq);
    }
    let (header, voxels) = &output.memory[0];
    assert!(header.key_frames == 12 && voxels.len() > 1000, "the measured scans did go into the map");
}

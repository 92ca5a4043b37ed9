//! Places that were not seen again, threads and coarse free space: what the configuration says comes true, in the mapper's map and
//! in that of whoever follows its updates.
#![allow(clippy::unwrap_used)]

mod common;

use common::{feed, mapper, pose, scan};
use evac_formats::octomap::ot_bytes;
use evac_octree::{MapConfig, OctreeMap, Pruning};
use evac_octree_mapper::{KeyFrameConfig, OctreeMapper, OctreeMapperConfig, UnseenAction, UnseenConfig};
use evac_stage::{Counters, MapOutput};

const EVERY_SCAN: KeyFrameConfig = KeyFrameConfig { distance_m: 0.0, angle_deg: 0.0, interval_s: 0.0 };

/// A look down the corridor, then 40 key frames of looking back; the mapper, and a map that has followed its updates.
fn walk(unseen: UnseenConfig, change: impl FnOnce(&mut OctreeMapperConfig)) -> (OctreeMapper, OctreeMap) {
    let mut config = OctreeMapperConfig { key_frames: EVERY_SCAN, unseen, ..OctreeMapperConfig::default() };
    change(&mut config);
    let mut mapper = mapper(config);
    let mut follower = OctreeMap::new(MapConfig::new(config.resolution_m)).unwrap();
    let (mut output, mut counters) = (MapOutput::newest_only(), Counters::default());
    for seq in 0..45 {
        let yaw = if seq < 5 { 0.0 } else { 180.0 };
        feed(&mut mapper, &scan(seq, &pose(3.0, yaw)), &mut output, &mut counters);
        for voxel in &output.memory[0].1 {
            follower.apply(voxel).unwrap();
        }
    }
    assert_eq!(counters, Counters::default());
    (mapper, follower)
}

fn ot(map: &OctreeMap) -> Vec<u8> {
    ot_bytes(&map.to_tree(Pruning::Full))
}

/// Voxels with a value more than 2 m before the sensor's first view, where only the first five scans have looked.
fn ahead(map: &OctreeMap) -> usize {
    map.voxels().filter(|voxel| map.space().centre(voxel.key)[0] > 5.0).count()
}

#[test]
fn what_was_not_seen_again_is_kept_forgotten_or_faded_and_a_follower_has_the_same_map() {
    let config = |action| UnseenConfig { action, after_key_frames: 16, fade_log_odds: 0.5 };
    let (kept, _) = walk(config(UnseenAction::Keep), |_| {});
    let (forgotten, follower) = walk(config(UnseenAction::Forget), |_| {});
    assert!(ahead(kept.map()) > 5_000);
    assert_eq!(ahead(forgotten.map()), 0);
    assert!(forgotten.map().known() > 5_000, "what is still seen stays");
    assert!(ot(&follower) == ot(forgotten.map()));

    let (faded, follower) = walk(config(UnseenAction::Fade), |_| {});
    let left = ahead(faded.map());
    assert!(left < ahead(kept.map()) && left > 0, "three steps of 0.5 leave what was certain: {left}");
    assert!(ot(&follower) == ot(faded.map()));
    let lowest = |mapper: &OctreeMapper| {
        let map = mapper.map();
        let values = map.voxels().filter(|voxel| map.space().centre(voxel.key)[0] > 5.0);
        values.map(|voxel| voxel.log_odds).fold(f32::INFINITY, f32::min)
    };
    assert!(lowest(&faded) > lowest(&kept) + 0.9);
}

#[test]
fn threads_change_nothing_and_coarse_free_space_gives_another_map() {
    let one = walk(UnseenConfig::default(), |_| {}).0;
    let two = walk(UnseenConfig::default(), |config| config.threads = 2).0;
    assert!(ot(one.map()) == ot(two.map()));
    let coarse = walk(UnseenConfig::default(), |config| config.coarse_free_space = true).0;
    assert!(ot(coarse.map()) != ot(one.map()));
    assert!(coarse.map().known() > one.map().known() / 2, "{} voxels", coarse.map().known());
}

//! The mapper as a stage: what goes into the map, what is published, what is counted.

mod common;

use common::{FLOOR, feed, mapper, pose, scan};
use evac_frames::{TrackingState, Voxel, frame_flags, map_flags, voxel_flags};
use evac_octree::{MapConfig, Occupancy, OctreeMap};
use evac_octree_mapper::{GroundConfig, KeyFrameConfig, OctreeMapper, OctreeMapperConfig, OutlierConfig};
use evac_stage::{Counters, MapOutput, Rig, Stage};

/// Walks down the corridor at 1.2 m/s for `frames` frames, turning a little.
fn walk(mapper: &mut OctreeMapper, frames: u64, output: &mut MapOutput, counters: &mut Counters) {
    for seq in 0..frames {
        feed(mapper, &scan(seq, &pose(0.12 * seq as f64, seq as f64)), output, counters);
    }
}

fn bits(voxels: impl Iterator<Item = Voxel>) -> Vec<([u16; 3], u16, u32)> {
    voxels.map(|voxel| (voxel.key, voxel.flags, voxel.log_odds.to_bits())).collect()
}

#[test]
fn every_scan_gives_one_update_and_key_frames_follow_the_walk() {
    let (mut output, mut counters) = (MapOutput::default(), Counters::default());
    let mut mapper = mapper(OctreeMapperConfig::default());
    walk(&mut mapper, 20, &mut output, &mut counters);
    assert_eq!(output.memory.len(), 20);
    for (seq, (header, voxels)) in output.memory.iter().enumerate() {
        let key_frame = seq % 3 == 0;
        assert_eq!(header.frame.seq, seq as u64);
        assert_eq!(header.map_flags & map_flags::KEY_FRAME != 0, key_frame, "seq {seq}");
        assert_eq!(header.key_frames, seq as u64 / 3 + 1);
        assert_eq!(!voxels.is_empty(), key_frame);
        assert_eq!(header.voxels as usize, voxels.len());
        assert!((header.position[0] - 0.12 * seq as f64).abs() < 1e-9);
        assert_eq!(header.resolution, 0.1);
    }
    assert_eq!(counters, Counters::default());
}

#[test]
fn updates_replayed_into_a_second_map_give_the_same_map_bit_for_bit() {
    let (mut output, mut counters) = (MapOutput::default(), Counters::default());
    let mut mapper = mapper(OctreeMapperConfig::default());
    walk(&mut mapper, 40, &mut output, &mut counters);
    let mut replayed = OctreeMap::new(MapConfig::new(0.1)).unwrap();
    for voxel in output.memory.iter().flat_map(|(_, voxels)| voxels) {
        replayed.apply(voxel).unwrap();
    }
    let expected = bits(mapper.map().voxels());
    assert!(expected.len() > 50_000, "{}", expected.len());
    assert_eq!(bits(replayed.voxels()), expected);
}

#[test]
fn a_snapshot_on_request_is_the_whole_map_and_joins_the_updates_that_follow() {
    let (mut output, mut counters) = (MapOutput::default(), Counters::default());
    let mut mapper = mapper(OctreeMapperConfig::default());
    walk(&mut mapper, 10, &mut output, &mut counters);
    output.request_snapshot = true;
    for seq in 10..20 {
        feed(&mut mapper, &scan(seq, &pose(0.12 * seq as f64, seq as f64)), &mut output, &mut counters);
    }
    assert_eq!(output.snapshots.len(), 1, "one request, one snapshot");
    let (header, voxels) = &output.snapshots[0];
    assert_eq!((header.frame.seq, header.map_flags), (10, map_flags::SNAPSHOT));
    assert_eq!(header.voxels as usize, voxels.len());
    let mut late = OctreeMap::new(MapConfig::new(0.1)).unwrap();
    let later = output.memory.iter().filter(|(update, _)| update.frame.seq > header.frame.seq);
    for voxel in voxels.iter().chain(later.flat_map(|(_, voxels)| voxels)) {
        late.apply(voxel).unwrap();
    }
    assert_eq!(bits(late.voxels()), bits(mapper.map().voxels()));
}

#[test]
fn ground_clears_and_is_marked_but_never_occupies_and_walls_do() {
    let (mut output, mut counters) = (MapOutput::default(), Counters::default());
    let mut mapper = mapper(OctreeMapperConfig::default());
    walk(&mut mapper, 40, &mut output, &mut counters);
    let map = mapper.map();
    let (mut ground, mut free_ground) = (0, 0);
    for voxel in map.voxels().filter(|voxel| voxel.flags & voxel_flags::GROUND != 0) {
        let [x, y, z] = map.space().centre(voxel.key);
        assert!((z - FLOOR).abs() < 0.21, "ground at z = {z}");
        ground += 1;
        // Apart from the foot of the walls, where the voxel holds some wall, too.
        if y.abs() < 1.3 && x < 14.7 {
            assert_ne!(map.occupancy(voxel.key), Occupancy::Occupied, "{:?}", map.space().centre(voxel.key));
            free_ground += usize::from(map.occupancy(voxel.key) == Occupancy::Free);
        }
    }
    assert!(ground > 500, "{ground} ground voxels");
    assert!(free_ground > 400, "{free_ground} free ground voxels");
    let occupied = |x: f32, y: f32, z: f32| map.occupancy(map.space().key([x, y, z]).unwrap());
    assert_eq!(occupied(7.0, 1.49, 0.0).max_with(occupied(7.0, 1.51, 0.0)), Occupancy::Occupied, "the wall");
    assert_eq!(occupied(7.0, 0.0, 0.0), Occupancy::Free, "the middle of the corridor");
    assert_eq!(occupied(7.0, 3.0, 0.0), Occupancy::Unknown, "behind the wall");
}

/// The stronger statement about a place of which a wall may fall into one or the other voxel.
trait MaxWith {
    fn max_with(self, other: Self) -> Self;
}

impl MaxWith for Occupancy {
    fn max_with(self, other: Self) -> Self {
        if self == Occupancy::Occupied { self } else { other }
    }
}

#[test]
fn without_the_ground_filter_the_floor_is_an_obstacle() {
    let (mut output, mut counters) = (MapOutput::default(), Counters::default());
    let ground = GroundConfig { enabled: false, ..Default::default() };
    let mut mapper = mapper(OctreeMapperConfig { ground, ..Default::default() });
    walk(&mut mapper, 4, &mut output, &mut counters);
    assert!(output.memory.iter().all(|(header, _)| header.ground == 0));
    let map = mapper.map();
    let on_floor = map.voxels().filter(|voxel| {
        let [_, y, z] = map.space().centre(voxel.key);
        (z - FLOOR).abs() < 0.1 && y.abs() < 1.0 && map.occupancy(voxel.key) == Occupancy::Occupied
    });
    assert!(on_floor.count() > 100);
}

#[test]
fn every_point_is_counted_by_what_became_of_it() {
    let (mut output, mut counters) = (MapOutput::default(), Counters::default());
    let mut config = OctreeMapperConfig::default();
    config.bounds.z_m = Some([-10.0, 1.2]);
    let mut mapper = mapper(config);
    let (header, mut points, pose) = scan(0, &pose(0.0, 0.0));
    let whole = points.len() as u32;
    let at = |x: f32, y: f32, z: f32| evac_frames::Point::new(x, y, z, 0, 0);
    points.extend([
        at(f32::NAN, 1.0, 0.0),
        at(1.0, f32::INFINITY, 0.0),
        at(3e38, 3e38, 0.0),
        at(0.0, 0.0, 0.0),
    ]);
    points.extend([at(0.2, 0.1, 0.0), at(500.0, 0.0, 0.0)]);
    points.extend([at(3.0, 0.2, 0.1), at(6.0, -0.3, 0.2)]);
    feed(&mut mapper, &(header, points, pose), &mut output, &mut counters);
    let (header, _) = &output.memory[0];
    assert_eq!(header.rejected, 4, "not finite, beyond numbers, no return");
    assert!((2..=5).contains(&header.outliers), "two strays in the air, and hardly a point of the corridor");
    assert!(header.outside > 2 && header.ground > 1000 && header.hits > 1000, "{header:?}");
    assert_eq!(header.hits + header.ground + header.outliers + header.outside + header.rejected, whole + 8);
    assert_eq!(counters, Counters { rejected: 4, ..Default::default() });
}

#[test]
fn lost_foreign_and_non_finite_poses_never_enter_the_map_and_count_as_degraded() {
    let (mut output, mut counters) = (MapOutput::default(), Counters::default());
    let mut mapper = mapper(OctreeMapperConfig::default());
    for (seq, state) in
        [TrackingState::Lost as u32, 77, TrackingState::Tracking as u32].into_iter().enumerate()
    {
        let mut frame = scan(seq as u64, &pose(0.0, 0.0));
        frame.2.state = state;
        if state == TrackingState::Tracking as u32 {
            frame.2.orientation[2] = f64::NAN;
            frame.2.position[1] = f64::NAN;
        }
        feed(&mut mapper, &frame, &mut output, &mut counters);
    }
    assert_eq!(counters, Counters { degraded: 3, ..Default::default() });
    assert_eq!(mapper.map().voxel_count(), 0);
    assert!(output.memory.iter().all(|(header, voxels)| {
        voxels.is_empty() && header.map_flags == 0 && header.position.iter().all(|x| x.is_finite())
    }));
}

#[test]
fn scans_of_an_initialising_odometry_enter_only_where_the_configuration_says_so() {
    for map_while_initialising in [false, true] {
        let (mut output, mut counters) = (MapOutput::default(), Counters::default());
        let mut mapper = mapper(OctreeMapperConfig { map_while_initialising, ..Default::default() });
        let mut frame = scan(0, &pose(0.0, 0.0));
        frame.2.state = TrackingState::Initialising as u32;
        feed(&mut mapper, &frame, &mut output, &mut counters);
        assert_eq!(mapper.map().voxel_count() > 0, map_while_initialising);
        assert_eq!(output.memory.len(), 1);
        assert_eq!(counters, Counters::default());
    }
}

#[test]
fn the_end_of_the_stream_is_passed_on() {
    let (mut output, mut counters) = (MapOutput::default(), Counters::default());
    let mut mapper = mapper(OctreeMapperConfig::default());
    let mut frame = scan(0, &pose(0.0, 0.0));
    frame.0.frame.flags = frame_flags::END_OF_STREAM;
    feed(&mut mapper, &frame, &mut output, &mut counters);
    assert_eq!(output.memory[0].0.frame.flags, frame_flags::END_OF_STREAM);
}

#[test]
fn a_full_map_says_so_and_goes_on() {
    let (mut output, mut counters) = (MapOutput::default(), Counters::default());
    let mut mapper =
        mapper(OctreeMapperConfig { resolution_m: 0.05, max_map_mib: 0.125, ..Default::default() });
    walk(&mut mapper, 4, &mut output, &mut counters);
    assert_eq!((output.memory.len(), counters.degraded), (4, 2), "both key frames are in it only in part");
    assert!(mapper.map().known() > 1000 && mapper.map().memory_bytes() <= 192 << 10);
}

#[test]
fn two_runs_give_the_same_updates_bit_for_bit() {
    let runs: Vec<_> = (0..2)
        .map(|_| {
            let (mut output, mut counters) = (MapOutput::default(), Counters::default());
            walk(&mut mapper(OctreeMapperConfig::default()), 12, &mut output, &mut counters);
            output.memory.into_iter().flat_map(|(_, voxels)| bits(voxels.into_iter())).collect::<Vec<_>>()
        })
        .collect();
    assert_eq!(runs[0], runs[1]);
}

#[test]
fn a_bad_configuration_is_refused_with_a_sentence() {
    let config = OctreeMapperConfig {
        outliers: OutlierConfig { radius_m: -1.0, ..Default::default() },
        ..Default::default()
    };
    let error = OctreeMapper::new(config, &Rig::default()).unwrap_err().to_string();
    assert!(error.contains("outliers.radius_m = -1 must lie between"), "{error}");
    let every_scan = KeyFrameConfig { distance_m: 0.0, angle_deg: 0.0, interval_s: 0.0 };
    assert!(
        OctreeMapper::new(
            OctreeMapperConfig { key_frames: every_scan, ..Default::default() },
            &Rig::default()
        )
        .is_ok()
    );
}

//! A mapper of our own beside the saver: scans of a small room from a moving sensor.

use std::collections::BTreeSet;
use std::path::Path;

use evac_formats::pcd::Reader;
use evac_frames::{FrameHeader, Point, ScanHeader, Voxel, voxel_flags};
use evac_geometry::nalgebra::{Isometry3, Vector3};
use evac_geometry::set_map_from_lidar;
use evac_octree::{Scan, ScanOptions};
use evac_stage::MapMessage;

use super::*;

const RESOLUTION: f64 = 0.1;

struct Bench {
    mapper: OctreeMap,
    saver: MapSaver,
    counters: Counters,
    folder: tempfile::TempDir,
}

impl Bench {
    fn new(change: impl FnOnce(&mut MapSaverConfig)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut config =
            MapSaverConfig { output_dir: folder.path().join("out"), ..MapSaverConfig::default() };
        change(&mut config);
        Self {
            mapper: OctreeMap::new(MapConfig::new(RESOLUTION)).unwrap(),
            saver: MapSaver::new(config, &Rig::default()).unwrap(),
            counters: Counters::default(),
            folder,
        }
    }

    fn walk(&mut self, frames: std::ops::Range<u64>) {
        for seq in frames {
            let map_from_lidar = Isometry3::new(
                Vector3::new(0.02 * seq as f64, 0.0, 0.0),
                Vector3::new(0.0, 0.0, 0.01 * seq as f64),
            );
            self.frame(seq, &map_from_lidar, TrackingState::Tracking, 0);
        }
    }

    /// Points on the walls of a box of 6 x 4 x 2 m around the map's origin, seen from the pose.
    fn frame(&mut self, seq: u64, map_from_lidar: &Isometry3<f64>, state: TrackingState, flags: u32) {
        let hits: Vec<[f32; 3]> = (0..400)
            .map(|i| {
                let angle = f64::from(i) * 0.0731 + seq as f64;
                let (dx, dy) = (angle.cos() / 3.0, angle.sin() / 2.0);
                let share = 1.0 / dx.abs().max(dy.abs());
                [(angle.cos() * share) as f32, (angle.sin() * share) as f32, -1.0 + (i % 20) as f32 * 0.1]
            })
            .collect();
        let origin: [f64; 3] = map_from_lidar.translation.vector.into();
        let scan = Scan { origin: origin.map(|axis| axis as f32), hits: &hits, ground: &[], misses: &[] };
        self.mapper.insert_scan(&scan, &ScanOptions::default());
        let voxels: Vec<Voxel> = self.mapper.changes().collect();
        let points: Vec<Point> = hits
            .iter()
            .map(|[x, y, z]| {
                let p = map_from_lidar.inverse() * Point3::new(*x, *y, *z).cast::<f64>();
                Point::new(p.x as f32, p.y as f32, p.z as f32, 0, seq as u8)
            })
            .collect();
        self.send(seq, map_from_lidar, state, flags, &voxels, &points, RESOLUTION);
    }

    #[expect(clippy::too_many_arguments)]
    fn send(
        &mut self,
        seq: u64,
        map_from_lidar: &Isometry3<f64>,
        state: TrackingState,
        flags: u32,
        voxels: &[Voxel],
        points: &[Point],
        resolution: f64,
    ) {
        let end_ns = 1_700_000_000_000_000_001 + seq as i64 * 100_000_000;
        let frame = FrameHeader { seq, end_ns, flags, ..FrameHeader::default() };
        let header = ScanHeader { frame, ..ScanHeader::default() };
        let map_header = MapHeader { frame, resolution, ..MapHeader::default() };
        let mut pose = PoseFrame { frame, state: state as u32, ..PoseFrame::default() };
        set_map_from_lidar(&mut pose, map_from_lidar);
        let map = MapMessage { header: &map_header, voxels };
        let input = SinkInput { header: &header, points, pose: &pose, map, truth: None };
        self.saver.process(input, &mut NoOutput, &mut self.counters).unwrap();
    }

    fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.folder.path().join("out").join(name)).unwrap()
    }

    fn has(&self, name: &str) -> bool {
        self.folder.path().join("out").join(name).exists()
    }
}

#[test]
fn the_saved_octree_is_the_mappers_own_byte_for_byte() {
    let mut bench = Bench::new(|_| {});
    bench.walk(0..40);
    bench.saver.finish().unwrap();
    let tree = bench.mapper.to_tree(Pruning::Full);
    assert!(bench.mapper.known() > 10_000);
    assert!(bench.read("map.ot") == octomap::ot_bytes(&tree));
    assert!(bench.read("map.bt") == octomap::bt_bytes(&tree, &bench.mapper.sensor().binary_values()));
    assert_eq!(bench.counters, Counters::default());
}

#[test]
fn a_saver_that_joins_late_starts_from_a_snapshot_and_ends_with_the_same_octree() {
    let mut bench = Bench::new(|_| {});
    bench.walk(0..20);
    let voxels: Vec<Voxel> = bench.mapper.voxels().collect();
    let mut late = Bench::new(|_| {});
    // What it holds before the snapshot is replaced.
    let stale = [Voxel { key: [1, 2, 3], flags: voxel_flags::KNOWN, log_odds: 1.0 }];
    late.send(0, &Isometry3::identity(), TrackingState::Tracking, 0, &stale, &[], RESOLUTION);
    let frame = FrameHeader { seq: 19, ..FrameHeader::default() };
    let header = ScanHeader { frame, ..ScanHeader::default() };
    let map_header =
        MapHeader { frame, resolution: RESOLUTION, map_flags: map_flags::SNAPSHOT, ..MapHeader::default() };
    let mut pose = PoseFrame { frame, state: TrackingState::Tracking as u32, ..PoseFrame::default() };
    set_map_from_lidar(&mut pose, &Isometry3::identity());
    let map = MapMessage { header: &map_header, voxels: &voxels };
    let input = SinkInput { header: &header, points: &[], pose: &pose, map, truth: Some(&pose) };
    late.saver.process(input, &mut NoOutput, &mut late.counters).unwrap();
    late.mapper = bench.mapper;
    late.walk(20..30);
    late.saver.finish().unwrap();
    // One frame before the snapshot and ten after it.
    assert_eq!(late.saver.trajectory.len(), 11);
    assert!(late.read("map.ot") == octomap::ot_bytes(&late.mapper.to_tree(Pruning::Full)));
}

#[test]
fn the_trajectory_has_each_frames_pose_at_its_end_to_the_nanosecond() {
    let mut bench = Bench::new(|_| {});
    bench.walk(0..30);
    bench.saver.finish().unwrap();
    let poses = tum::read(&bench.folder.path().join("out/trajectory.tum")).unwrap();
    assert_eq!(poses.len(), 30);
    for (pose, seq) in poses.iter().zip(0i64..) {
        assert_eq!(pose.stamp_ns, 1_700_000_000_000_000_001 + seq * 100_000_000);
        assert!((pose.position[0] - 0.02 * seq as f64).abs() < 1e-9);
        assert!((pose.orientation[2] - (0.005 * seq as f64).sin()).abs() < 1e-9);
    }
    assert!(!bench.has("truth.tum"), "no simulator ran");
}

#[test]
fn truth_is_saved_where_there_is_one() {
    let mut bench = Bench::new(|_| {});
    let frame = FrameHeader { end_ns: 5, ..FrameHeader::default() };
    let pose = PoseFrame { frame, orientation: [0.0, 0.0, 0.0, 1.0], ..PoseFrame::default() };
    let truth = PoseFrame { position: [1.0, 2.0, 3.0], ..pose };
    let (header, map_header) = (
        ScanHeader { frame, ..ScanHeader::default() },
        MapHeader { resolution: 0.1, ..MapHeader::default() },
    );
    let map = MapMessage { header: &map_header, voxels: &[] };
    let input = SinkInput { header: &header, points: &[], pose: &pose, map, truth: Some(&truth) };
    bench.saver.process(input, &mut NoOutput, &mut bench.counters).unwrap();
    bench.saver.finish().unwrap();
    let saved = tum::read(&bench.folder.path().join("out/truth.tum")).unwrap();
    assert_eq!(saved, [TumPose { stamp_ns: 5, position: truth.position, orientation: truth.orientation }]);
}

#[test]
fn the_cloud_lies_on_the_walls_with_one_point_a_cell() {
    let mut bench = Bench::new(|_| {});
    bench.walk(0..60);
    bench.saver.finish().unwrap();
    let path = bench.folder.path().join("out/cloud.pcd");
    let points: Vec<_> = Reader::open(&path).unwrap().collect::<Result<_, _>>().unwrap();
    // 24,000 points on 20 x 2 m of wall: 16,000 cells of 5 cm, in each of which at most one stays.
    assert!((3_000..12_000).contains(&points.len()), "{}", points.len());
    for point in &points {
        let off_wall = (point.x.abs() - 3.0).abs().min((point.y.abs() - 2.0).abs());
        assert!(off_wall < 1e-4, "{point:?}");
    }
    let cells: BTreeSet<_> =
        points.iter().map(|p| [p.x, p.y, p.z].map(|axis| (f64::from(axis) / 0.05).floor() as i64)).collect();
    assert_eq!(cells.len(), points.len());
    assert!(points.iter().any(|point| point.intensity == 3.0), "the reflectivity is kept");
}

#[test]
fn scans_without_a_trustworthy_pose_stay_out_of_the_cloud() {
    let mut bench = Bench::new(|_| {});
    bench.frame(0, &Isometry3::identity(), TrackingState::Initialising, 0);
    assert_eq!(bench.counters.degraded, 0, "a standstill at the start is no fault");
    bench.frame(1, &Isometry3::identity(), TrackingState::Lost, 0);
    bench.frame(2, &Isometry3::translation(f64::NAN, 0.0, 0.0), TrackingState::Tracking, 0);
    assert_eq!(bench.saver.cloud.points(), []);
    // The frame that is not finite is missing in the cloud and in the trajectory.
    assert_eq!(bench.counters.degraded, 3);
    bench.frame(3, &Isometry3::identity(), TrackingState::Degenerate, 0);
    assert!(!bench.saver.cloud.points().is_empty());
    bench.saver.finish().unwrap();
    assert_eq!(tum::read(&bench.folder.path().join("out/trajectory.tum")).unwrap().len(), 3);
}

#[test]
fn ceilings_hold_and_what_goes_beyond_is_counted() {
    let mut bench = Bench::new(|config| {
        config.max_cloud_points = 10;
        config.max_poses = 2;
        config.max_map_mib = 0.0625;
    });
    bench.walk(0..3);
    assert_eq!(bench.saver.cloud.points().len(), 10);
    assert_eq!(bench.saver.trajectory.len(), 2);
    assert!(bench.counters.rejected > 1000);
    assert_eq!(bench.counters.degraded, 1);
}

#[test]
fn files_are_saved_at_the_interval_at_the_end_and_when_told_to_stop() {
    let mut bench = Bench::new(|config| config.save_interval_s = 1.0);
    bench.walk(0..10);
    assert!(!bench.has("map.ot"));
    bench.walk(10..11);
    assert!(bench.has("map.ot") && bench.has("cloud.pcd"), "after a second of sensor time");
    let early = bench.read("trajectory.tum").len();
    bench.walk(11..15);
    assert_eq!(bench.read("trajectory.tum").len(), early);
    bench.frame(15, &Isometry3::identity(), TrackingState::Tracking, frame_flags::END_OF_STREAM);
    assert!(bench.read("trajectory.tum").len() > early, "at the end of the stream");
    fs::remove_file(bench.folder.path().join("out/map.ot")).unwrap();
    bench.saver.finish().unwrap();
    assert!(!bench.has("map.ot"), "nothing new to save");
    bench.walk(16..17);
    bench.saver.finish().unwrap();
    assert!(bench.has("map.ot"), "stopped in the middle");
}

#[test]
fn updates_of_another_resolution_are_left_out_and_counted() {
    let mut bench = Bench::new(|_| {});
    bench.walk(0..2);
    let known = bench.saver.map.as_ref().unwrap().known();
    let voxel = [Voxel { key: [9, 9, 9], flags: voxel_flags::KNOWN, log_odds: 1.0 }];
    bench.send(2, &Isometry3::identity(), TrackingState::Tracking, 0, &voxel, &[], 0.2);
    assert_eq!(bench.saver.map.as_ref().unwrap().known(), known);
    assert_eq!(bench.counters.degraded, 1);
}

#[test]
fn two_runs_write_the_same_bytes() {
    let files = || {
        let mut bench = Bench::new(|_| {});
        bench.walk(0..25);
        bench.saver.finish().unwrap();
        ["map.ot", "map.bt", "trajectory.tum", "cloud.pcd"].map(|name| bench.read(name))
    };
    assert!(files() == files());
}

#[test]
fn a_folder_that_cannot_be_made_is_named() {
    let output_dir = Path::new("/dev/null/out").to_owned();
    let result = MapSaver::new(MapSaverConfig { output_dir, ..MapSaverConfig::default() }, &Rig::default());
    assert!(result.err().unwrap().to_string().contains("/dev/null/out"));
}

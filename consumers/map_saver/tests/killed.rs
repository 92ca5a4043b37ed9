//! `kill -9` while the map is being written: what is there afterwards is whole.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use evac_formats::{octomap, pcd, tum};
use evac_frames::{
    FrameHeader, MapHeader, Point, PoseFrame, ScanHeader, TrackingState, Voxel, frame_flags, voxel_flags,
};
use evac_map_saver::{MapSaver, MapSaverConfig};
use evac_stage::{Counters, MapMessage, NoOutput, Rig, SinkInput, Stage};
use evac_testkit::{folder_of_killed, kill_while_writing};

/// Not a test of its own: the process that `a_killed_saver_leaves_whole_files` starts. It saves without a pause, each time some
/// voxels, a pose and some points more.
#[test]
#[ignore = "the process that the other test kills"]
fn saves_without_a_pause() {
    let Some(folder) = folder_of_killed() else { return };
    let config = MapSaverConfig { output_dir: folder, ..MapSaverConfig::default() };
    let mut stage = MapSaver::new(config, &Rig::default()).unwrap();
    for seq in 0..10_000_u16 {
        let voxel = |number: u16| Voxel {
            key: [32_768 + number % 60, 32_768 + number / 60, 32_768 + seq],
            flags: voxel_flags::KNOWN,
            log_odds: f32::from(number % 7) - 3.0,
        };
        let voxels: Vec<Voxel> = (0..3600).map(voxel).collect();
        let points: Vec<Point> =
            (0..1000).map(|n| Point::new(n as f32 * 0.1, f32::from(seq) * 0.1, 0.0, 0, 9)).collect();
        let end_ns = i64::from(seq) * 100_000_000;
        let frame = FrameHeader { end_ns, flags: frame_flags::END_OF_STREAM, ..FrameHeader::default() };
        let header = ScanHeader { frame, ..ScanHeader::default() };
        let map_header = MapHeader { frame, resolution: 0.1, ..MapHeader::default() };
        let orientation = [0.0, 0.0, 0.0, 1.0];
        let pose =
            PoseFrame { frame, orientation, state: TrackingState::Tracking as u32, ..PoseFrame::default() };
        let map = MapMessage { header: &map_header, voxels: &voxels };
        let input = SinkInput { header: &header, points: &points, pose: &pose, map, truth: None };
        stage.process(input, &mut NoOutput, &mut Counters::default()).unwrap();
    }
}

/// Poses, after a look at every file.
fn check(folder: &Path) -> usize {
    for map in ["map.ot", "map.bt"] {
        assert!(!octomap::read(&folder.join(map)).unwrap().nodes().is_empty(), "{map}");
    }
    let points: Vec<_> =
        pcd::Reader::open(&folder.join("cloud.pcd")).unwrap().collect::<Result<_, _>>().unwrap();
    assert!(points.len() >= 1000);
    tum::read(&folder.join("trajectory.tum")).unwrap().len()
}

#[test]
fn a_killed_saver_leaves_whole_files() {
    let folder = tempfile::tempdir().unwrap();
    let mut lengths = Vec::new();
    let look = || lengths.push(check(folder.path()));
    kill_while_writing("saves_without_a_pause", folder.path(), "cloud.pcd", 25, look).unwrap();
    lengths.sort_unstable();
    lengths.dedup();
    assert!(lengths.len() > 3, "killed at different lengths: {lengths:?}");
}

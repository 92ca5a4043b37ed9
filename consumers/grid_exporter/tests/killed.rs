//! `kill -9` while plans are being written: what is there afterwards is whole.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use evac_formats::{occupancy_grid, pfm};
use evac_frames::{FrameHeader, MapHeader, PoseFrame, TrackingState, Voxel, frame_flags, voxel_flags};
use evac_grid_exporter::{GridExporter, GridExporterConfig};
use evac_stage::{Counters, GridOutput, MapMessage, PlanInput, Rig, Stage};
use evac_testkit::{folder_of_killed, kill_while_writing};

/// Not a test of its own: the process that `a_killed_exporter_leaves_whole_files` starts. It saves without a pause, each time a room
/// that is longer by one cell.
#[test]
#[ignore = "the process that the other test kills"]
fn saves_without_a_pause() {
    let Some(folder) = folder_of_killed() else { return };
    let config = GridExporterConfig { output_dir: folder, ..GridExporterConfig::default() };
    let mut stage = GridExporter::new(config, &Rig::default()).unwrap();
    for length in 0..10_000 {
        let wall = |y: i32| y == 0 || y == 30;
        let column = |y: i32| {
            (0..20).map(move |z| Voxel {
                key: [-length, y, z - 12].map(|axis| (axis + 32_768) as u16),
                flags: voxel_flags::KNOWN | if z == 0 && !wall(y) { voxel_flags::GROUND } else { 0 },
                log_odds: if wall(y) { 2.0 } else { -1.0 },
            })
        };
        let voxels: Vec<Voxel> = (0..=30).flat_map(column).collect();
        let frame = FrameHeader {
            end_ns: i64::from(length) * 100_000_000,
            flags: frame_flags::END_OF_STREAM,
            ..FrameHeader::default()
        };
        let position = [-0.1 * f64::from(length), 1.5, 0.0];
        let header = MapHeader { frame, resolution: 0.1, position, ..MapHeader::default() };
        let pose =
            PoseFrame { frame, position, state: TrackingState::Tracking as u32, ..PoseFrame::default() };
        let input = PlanInput { map: MapMessage { header: &header, voxels: &voxels }, pose: &pose };
        stage.process(input, &mut GridOutput::default(), &mut Counters::default()).unwrap();
    }
}

/// Cells along x, after a look at every file.
fn check(folder: &Path) -> u32 {
    let path = |name: &str| folder.join(name);
    let grid = occupancy_grid::read(&path("plan.yaml")).unwrap();
    // The picture is that of this origin: the room's right end has never moved.
    let right = grid.origin[0] + f64::from(grid.width) * grid.resolution;
    assert!((right - 0.8).abs() < 0.01, "the right end lies at {right} m");
    for layer in ["plan_ground.pfm", "plan_step.pfm"] {
        let (width, pixels) = pfm::read(&path(layer)).unwrap();
        assert_eq!(pixels.len() % width as usize, 0);
    }
    for picture in ["plan.png", "plan_ground.png"] {
        let bytes = std::fs::read(path(picture)).unwrap();
        assert!(bytes.starts_with(b"\x89PNG") && bytes.ends_with(b"IEND\xae\x42\x60\x82"), "{picture}");
    }
    let listing = std::fs::read_to_string(path("storeys.json")).unwrap();
    assert!(listing.starts_with("[\n") && listing.ends_with("\n]\n"));
    grid.width
}

#[test]
fn a_killed_exporter_leaves_whole_files() {
    let folder = tempfile::tempdir().unwrap();
    let mut widths = Vec::new();
    let look = || widths.push(check(folder.path()));
    kill_while_writing("saves_without_a_pause", folder.path(), "storeys.json", 40, look).unwrap();
    widths.sort_unstable();
    widths.dedup();
    assert!(widths.len() > 1, "killed at different sizes: {widths:?}");
}

//! Physics of the plan on synthetic buildings at 0.1 m: the LiDAR starts at the map's origin, 1.2 m above the ground.

use std::fs;

use evac_formats::occupancy_grid::{FREE, OCCUPIED, OccupancyGrid, UNKNOWN};
use evac_frames::{PoseFrame, Voxel, voxel_flags};
use evac_stage::MapMessage;

use super::*;

mod floors;
mod messages;
mod obstacles;

const RESOLUTION: f64 = 0.1;
const SENSOR_HEIGHT: f64 = 1.2;
const OCCUPIED_VALUE: f32 = 2.0;
const FREE_VALUE: f32 = -1.0;

struct Bench {
    stage: GridExporter,
    output: GridOutput,
    counters: Counters,
    folder: tempfile::TempDir,
    time_ns: i64,
    state: TrackingState,
}

impl Bench {
    fn new() -> Self {
        Self::with(|_| {})
    }

    fn with(change: impl FnOnce(&mut GridExporterConfig)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut config =
            GridExporterConfig { output_dir: folder.path().join("out"), ..GridExporterConfig::default() };
        change(&mut config);
        Self {
            stage: GridExporter::new(config, &Rig::default()).unwrap(),
            output: GridOutput::default(),
            counters: Counters::default(),
            folder,
            time_ns: 0,
            state: TrackingState::Tracking,
        }
    }

    fn send(&mut self, position: [f64; 3], voxels: &[Voxel], flags: u32) {
        self.time_ns += 100_000_000;
        let frame = FrameHeader { end_ns: self.time_ns, ..FrameHeader::default() };
        let header =
            MapHeader { frame, resolution: RESOLUTION, position, map_flags: flags, ..MapHeader::default() };
        let pose = PoseFrame { frame, position, state: self.state as u32, ..PoseFrame::default() };
        let input = PlanInput { map: MapMessage { header: &header, voxels }, pose: &pose };
        self.stage.process(input, &mut self.output, &mut self.counters).unwrap();
    }

    fn walk(&mut self, from: [f64; 3], to: [f64; 3], voxels: &[Voxel]) {
        self.send(from, voxels, 0);
        for i in 1..=50 {
            let share = f64::from(i) / 50.0;
            let position = [0, 1, 2].map(|axis: usize| from[axis] + (to[axis] - from[axis]) * share);
            self.send(position, &[], 0);
        }
    }

    fn plan(&mut self) -> Plan {
        self.stage.finish().unwrap();
        let read = evac_formats::occupancy_grid::read(&self.folder.path().join("out/plan.yaml"));
        Plan(read.unwrap())
    }
}

struct Plan(OccupancyGrid);

impl Plan {
    /// The cell at a place, metres.
    fn at(&self, x: f64, y: f64) -> i8 {
        let [cx, cy] = [(x, self.0.origin[0]), (y, self.0.origin[1])]
            .map(|(value, origin)| ((value - origin) / self.0.resolution).floor() as i64);
        let inside =
            (0..i64::from(self.0.width)).contains(&cx) && (0..i64::from(self.0.height)).contains(&cy);
        if inside { self.0.cells[cy as usize * self.0.width as usize + cx as usize] } else { UNKNOWN }
    }

    fn count(&self, state: i8) -> usize {
        self.0.cells.iter().filter(|cell| **cell == state).count()
    }
}

fn voxel(x: f64, y: f64, z: f64, log_odds: f32, flags: u16) -> Voxel {
    let key = [x, y, z].map(|axis| ((axis / RESOLUTION).floor() as i32 + 32_768) as u16);
    Voxel { key, flags, log_odds }
}

/// Centres of the voxels from `low` to `high`.
fn steps(low: f64, high: f64) -> impl Iterator<Item = f64> + Clone {
    let count = ((high - low) / RESOLUTION).round() as i32;
    (0..count).map(move |i| low + (f64::from(i) + 0.5) * RESOLUTION)
}

/// A column: ground at `ground`, then free, or occupied where `solid` says so by the height above ground.
fn column(voxels: &mut Vec<Voxel>, x: f64, y: f64, ground: f64, solid: impl Fn(f64) -> bool) {
    voxels.push(voxel(x, y, ground, FREE_VALUE, voxel_flags::KNOWN | voxel_flags::GROUND));
    for above in steps(0.1, 2.6) {
        let value = if solid(above) { OCCUPIED_VALUE } else { FREE_VALUE };
        voxels.push(voxel(x, y, ground + above, value, voxel_flags::KNOWN));
    }
}

/// A wall over one cell: seen from the side, so without ground below it.
fn wall(voxels: &mut Vec<Voxel>, x: f64, y: f64, ground: f64) {
    for above in steps(0.0, 2.6) {
        voxels.push(voxel(x, y, ground + above, OCCUPIED_VALUE, voxel_flags::KNOWN));
    }
}

/// Walls around x from -1 to 5 m, y from -2 to 2 m, a door in the wall at x = 5 from y = -0.5 to 0.5 m, a ceiling.
fn room(ground: f64) -> Vec<Voxel> {
    let mut voxels = Vec::new();
    for (x, y) in steps(-1.0, 5.0).flat_map(|x| steps(-2.0, 2.0).map(move |y| (x, y))) {
        if x < -0.9 || y.abs() > 1.9 || (x > 4.9 && y.abs() > 0.5) {
            wall(&mut voxels, x, y, ground);
        } else {
            column(&mut voxels, x, y, ground, |above| above > 2.4);
        }
    }
    voxels
}

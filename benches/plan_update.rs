//! What one map update costs the plan, over the size of the map: buildings of ever more rooms at 0.1 m, in which always the same
//! thing changes. `cargo bench --bench plan_update -- --chart docs/plan-cost.png` draws the figures. See benches/README.md.
#![allow(clippy::expect_used)] // defaults fit, and memory is enough

mod support;

use std::path::Path;
use std::time::Instant;

use evac_frames::{FrameHeader, MapHeader, PoseFrame, TrackingState, Voxel, voxel_flags};
use evac_grid_exporter::{GridExporter, GridExporterConfig};
use evac_picture::{LineChart, Panel, Series, Stroke, line_chart};
use evac_stage::{Counters, GridOutput, MapMessage, PlanInput, Rig, Stage};

use crate::support::{Distribution, is_trial, print_heading};

const RESOLUTION: f64 = 0.1;
/// Cells along a room's side: 8 m.
const ROOM: i32 = 80;
/// Height of the sensor in voxels.
const SENSOR: i32 = 12;
/// Times that a thing comes and goes.
const ROUNDS: usize = 60;

fn main() -> anyhow::Result<()> {
    let sides: &[i32] = if is_trial() { &[1, 2] } else { &[2, 4, 8, 12, 16, 24] };
    let mut rows: [Vec<[f64; 2]>; 4] = Default::default();
    print_heading("one map update in the plan");
    for side in sides {
        let square_metres = f64::from((side * ROOM).pow(2)) * RESOLUTION * RESOLUTION;
        let mut building = Building::new(*side, 3600.0)?;
        let times = [building.changes(4), building.changes(30), building.anew()];
        let published = Building::new(*side, 0.0)?.changes(30);
        let [small, large, anew] = times;
        let cases = [
            ("a person, 256 voxels", small),
            ("a key frame, 14,400 voxels", large),
            ("a key frame, and the message", published),
            ("everything anew", anew),
        ];
        for ((name, times), row) in cases.into_iter().zip(&mut rows) {
            if let Some(summary) = times.summary() {
                println!("{:<34} {summary}", format!("{square_metres:>6} m², {name}"));
                row.push([square_metres, summary.p50_us * 1e-3]);
            }
        }
    }
    let mut arguments = std::env::args().skip_while(|argument| argument != "--chart").skip(1);
    if let Some(path) = arguments.next() {
        chart(Path::new(&path), rows)?;
    }
    Ok(())
}

fn chart(path: &Path, [small, large, published, anew]: [Vec<[f64; 2]>; 4]) -> anyhow::Result<()> {
    let panel = |y_label: &str, series: Vec<Series>| Panel {
        y_label: y_label.to_owned(),
        y_range: None,
        min_span: 0.0,
        series,
    };
    let updates = vec![
        Series::line("a person, 256 voxels", Stroke::nth(0), small),
        Series::line("a key frame, 14,400 voxels", Stroke::nth(1), large.clone()),
        Series::line("a key frame, and the message", Stroke::nth(2).dashed(), published),
    ];
    let all = vec![
        Series::line("everything anew", Stroke::nth(3), anew),
        Series::line("a key frame, 14,400 voxels", Stroke::nth(1), large),
    ];
    let chart = LineChart {
        title: "One map update in the plan, cells of 0.1 m".to_owned(),
        x_label: "size of the map (m²)".to_owned(),
        panels: vec![panel("median (ms)", updates), panel("median (ms)", all)],
    };
    Ok(line_chart(path, &chart)?)
}

/// Square rooms side by side, all walked through.
struct Building {
    stage: GridExporter,
    output: GridOutput,
    time_ns: i64,
    position: [f64; 3],
    _folder: tempfile::TempDir,
}

impl Building {
    fn new(side: i32, publish_interval_s: f64) -> anyhow::Result<Self> {
        let folder = tempfile::tempdir()?;
        let config = GridExporterConfig {
            output_dir: folder.path().to_owned(),
            publish_interval_s,
            save_interval_s: 0.0,
            ..GridExporterConfig::default()
        };
        let stage = GridExporter::new(config, &Rig::default())?;
        let mut building =
            Self { stage, output: GridOutput::default(), time_ns: 0, position: [0.0; 3], _folder: folder };
        for (row, column) in (0..side).flat_map(|row| (0..side).map(move |column| (row, column))) {
            // To and fro, through the doors in the middle of the walls.
            let column = if row % 2 == 0 { column } else { side - 1 - column };
            let corner = [column * ROOM, row * ROOM];
            let voxels: Vec<Voxel> = room(corner).collect();
            building.walk_to(corner.map(|axis| f64::from(axis + ROOM / 2) * RESOLUTION));
            building.send(&voxels);
        }
        Ok(building)
    }

    fn walk_to(&mut self, [x, y]: [f64; 2]) {
        let [from_x, from_y, z] = self.position;
        for step in 1..=40 {
            let share = f64::from(step) / 40.0;
            self.position = [from_x + (x - from_x) * share, from_y + (y - from_y) * share, z];
            self.send(&[]);
        }
    }

    fn send(&mut self, voxels: &[Voxel]) {
        self.time_ns += 100_000_000;
        let frame = FrameHeader { end_ns: self.time_ns, ..FrameHeader::default() };
        let position = self.position;
        let header = MapHeader { frame, resolution: RESOLUTION, position, ..MapHeader::default() };
        let pose =
            PoseFrame { frame, position, state: TrackingState::Tracking as u32, ..PoseFrame::default() };
        let input = PlanInput { map: MapMessage { header: &header, voxels }, pose: &pose };
        self.output.memory.clear();
        self.stage.process(input, &mut self.output, &mut Counters::default()).expect("memory is enough");
    }

    /// Something of `size` x `size` cells comes and goes in the corner of the room in which the walk has ended.
    fn changes(&mut self, size: i32) -> Distribution {
        let [x, y, _] = self.position.map(|axis| (axis / RESOLUTION).floor() as i32 - ROOM / 2 + 5);
        let mut times = Distribution::default();
        for round in 0..ROUNDS {
            let log_odds = if round % 2 == 0 { 2.0 } else { -1.0 };
            let column = |(x, y): (i32, i32)| (1..17).map(move |z| voxel([x, y, z], 0, log_odds));
            let cells = (x..x + size).flat_map(|x| (y..y + size).map(move |y| (x, y)));
            let voxels: Vec<Voxel> = cells.flat_map(column).collect();
            let start = Instant::now();
            self.send(&voxels);
            times.record(start.elapsed().as_nanos() as i64);
        }
        times
    }

    fn anew(&mut self) -> Distribution {
        let mut times = Distribution::default();
        for _ in 0..5 {
            let start = Instant::now();
            self.stage.project_anew();
            times.record(start.elapsed().as_nanos() as i64);
        }
        times
    }
}

/// Floor, air, and walls with a door in the middle of each.
fn room([x0, y0]: [i32; 2]) -> impl Iterator<Item = Voxel> {
    let cells = (0..ROOM).flat_map(|x| (0..ROOM).map(move |y| (x, y)));
    cells.flat_map(move |(x, y)| {
        let door = |along: i32| (ROOM / 2 - 6..ROOM / 2 + 6).contains(&along);
        let wall = x == 0 && !door(y) || y == 0 && !door(x);
        (0..17).map(move |z| {
            let ground = if z == 0 && !wall { voxel_flags::GROUND } else { 0 };
            voxel([x0 + x, y0 + y, z], ground, if wall { 2.0 } else { -1.0 })
        })
    })
}

/// A voxel by its height above the floor.
fn voxel([x, y, z]: [i32; 3], flags: u16, log_odds: f32) -> Voxel {
    let key = [x, y, z - SENSOR].map(|axis| (axis + 32_768) as u16);
    Voxel { key, flags: flags | voxel_flags::KNOWN, log_odds }
}

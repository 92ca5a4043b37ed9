//! Simulated walks through the mapper and the exporter, with true poses, and what the buildings truly look like.
#![allow(
    dead_code,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "each test uses a part; a helper that fails, fails its test"
)]

use std::collections::HashMap;
use std::path::PathBuf;

use evac_formats::occupancy_grid::{self, OccupancyGrid, UNKNOWN};
use evac_frames::{Point, PoseFrame, ScanHeader};
use evac_geometry::nalgebra::Point3;
use evac_grid_exporter::{GridExporter, GridExporterConfig};
use evac_octree_mapper::{OctreeMapper, OctreeMapperConfig};
use evac_simulator::{Config, Frame, Walk, simulate};
use evac_stage::{Counters, GridOutput, MapMessage, MapOutput, PlanInput, Rig, ScanWithPose, Stage};
use tempfile::TempDir;

/// What has become of a walk.
pub struct Survey {
    pub folder: TempDir,
    /// Of the whole walk, for its truth.
    pub walk: Walk,
    /// How many returns ended in a cell of the plan's size up to a person's height.
    pub seen: HashMap<[i64; 2], u32>,
    /// Height of the floor below the start in the map frame, metres.
    pub floor: f64,
    pub resolution: f64,
}

/// Walks through a world; `settle` may change how it is mapped and drawn.
pub fn survey(
    world: &Config,
    resolution: f64,
    settle: impl FnOnce(&mut OctreeMapperConfig, &mut GridExporterConfig),
) -> Survey {
    let folder = tempfile::tempdir().unwrap();
    let mut mapper_config = OctreeMapperConfig { resolution_m: resolution, ..OctreeMapperConfig::default() };
    let mut config = GridExporterConfig {
        output_dir: folder.path().to_owned(),
        publish_interval_s: 3600.0,
        save_interval_s: 0.0,
        ..GridExporterConfig::default()
    };
    settle(&mut mapper_config, &mut config);
    let rig = Rig::default();
    let mut mapper = OctreeMapper::new(mapper_config, &rig).unwrap();
    let mut exporter = GridExporter::new(config, &rig).unwrap();
    let (mut maps, mut grids) = (MapOutput::newest_only(), GridOutput::default());
    let mut counters = Counters::default();

    let frames = simulate(world, &rig).unwrap();
    let walk = frames.walk().clone();
    // The ground below the first pose.
    let down = walk.map_from_lidar(100_000_000).rotation.inverse() * -evac_geometry::nalgebra::Vector3::z();
    let floor = walk.cast(100_000_000, &down, 10.0).unwrap().z;
    let mut survey = Survey { folder, walk, seen: HashMap::new(), floor, resolution };
    for frame in frames {
        let (header, points, pose) = survey.deskewed(&frame);
        mapper
            .process(ScanWithPose { header: &header, points: &points, pose: &pose }, &mut maps, &mut counters)
            .unwrap();
        let (header, voxels) = maps.memory.last().unwrap();
        let input = PlanInput { map: MapMessage { header, voxels }, pose: &pose };
        exporter.process(input, &mut grids, &mut counters).unwrap();
    }
    exporter.finish().unwrap();
    assert_eq!(counters.rejected + counters.degraded, 0, "{counters:?}");
    survey
}

impl Survey {
    /// The returns of a frame as a perfect deskewer gives them, in the LiDAR frame at the scan's end.
    fn deskewed(&mut self, frame: &Frame) -> (ScanHeader, Vec<Point>, PoseFrame) {
        let FrameHeaderTimes { start, end } = FrameHeaderTimes::of(frame);
        let end_from_map = self.walk.map_from_lidar(end).inverse();
        let mut points = Vec::with_capacity(frame.points.len());
        // The shots come in packets of 100 us: one pose for each is exact to a tenth of a millimetre.
        let mut packet = (i64::MIN, self.walk.map_from_lidar(start));
        for point in frame.points.iter().filter(|point| point.is_return()) {
            let time = (start + point.offset_ns()) / 1_000_000 * 1_000_000;
            if time != packet.0 {
                packet = (time, self.walk.map_from_lidar(time + 500_000));
            }
            let place = packet.1 * Point3::new(point.x, point.y, point.z).cast::<f64>();
            if (self.floor - 0.1..self.floor + 1.8).contains(&place.z) {
                *self.seen.entry(self.cell(place.x, place.y)).or_default() += 1;
            }
            let moved = end_from_map * place;
            points.push(point.moved_to(moved.x as f32, moved.y as f32, moved.z as f32));
        }
        let header = ScanHeader { points: points.len() as u32, ..frame.header };
        (header, points, frame.truth)
    }

    fn cell(&self, x: f64, y: f64) -> [i64; 2] {
        [x, y].map(|axis| (axis / self.resolution).floor() as i64)
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Copies the files to the folder that `EVAC_KEEP` names, if it does: to look at them.
    pub fn keep(&self, name: &str) {
        let Ok(folder) = std::env::var("EVAC_KEEP") else { return };
        for file in std::fs::read_dir(self.folder.path()).unwrap() {
            let file = file.unwrap();
            std::fs::copy(file.path(), format!("{folder}/{name}_{}", file.file_name().to_string_lossy()))
                .unwrap();
        }
    }

    pub fn plan(&self, name: &str) -> OccupancyGrid {
        occupancy_grid::read(&self.path(name)).unwrap()
    }

    /// Whether something of the building stands in the band over a floor, within `margin` metres around a place.
    pub fn stands(&self, x: f64, y: f64, floor: f64, [low, high]: [f64; 2], margin: f64) -> bool {
        let offsets: &[[f64; 2]] = if margin > 0.0 {
            &[
                [0.0, 0.0],
                [1.0, 0.0],
                [-1.0, 0.0],
                [0.0, 1.0],
                [0.0, -1.0],
                [0.7, 0.7],
                [-0.7, 0.7],
                [0.7, -0.7],
                [-0.7, -0.7],
            ]
        } else {
            &[[0.0, 0.0]]
        };
        let steps = ((high - low) / 0.1).round() as i32;
        offsets.iter().any(|[dx, dy]| {
            (0..=steps).any(|i| {
                let z = floor + low + (high - low) * f64::from(i) / f64::from(steps);
                self.walk.is_solid(&Point3::new(x + dx * margin, y + dy * margin, z))
            })
        })
    }
}

struct FrameHeaderTimes {
    start: i64,
    end: i64,
}

impl FrameHeaderTimes {
    fn of(frame: &Frame) -> Self {
        Self { start: frame.header.frame.start_ns, end: frame.header.frame.end_ns }
    }
}

/// The centres of a plan's cells with what they are.
pub fn cells(grid: &OccupancyGrid) -> impl Iterator<Item = ([f64; 2], i8)> {
    let width = grid.width as usize;
    grid.cells.iter().enumerate().map(move |(place, cell)| {
        let at = |cells: usize, origin: f64| origin + (cells as f64 + 0.5) * grid.resolution;
        ([at(place % width, grid.origin[0]), at(place / width, grid.origin[1])], *cell)
    })
}

/// The cell at a place, metres; unknown outside.
pub fn at(grid: &OccupancyGrid, x: f64, y: f64) -> i8 {
    let [cx, cy] = [(x, grid.origin[0]), (y, grid.origin[1])]
        .map(|(value, origin)| ((value - origin) / grid.resolution).floor() as i64);
    let inside = (0..i64::from(grid.width)).contains(&cx) && (0..i64::from(grid.height)).contains(&cy);
    if inside { grid.cells[cy as usize * grid.width as usize + cx as usize] } else { UNKNOWN }
}

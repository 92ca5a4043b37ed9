//! Walks that an odometry is judged on: many buildings, gaits, speeds and rigs, none of them like another.

use std::path::{Path, PathBuf};

use evac_stage::Rig;

use crate::config::Config;
use crate::world_kind::WorldKind;

/// What the surfaces of a walk's building are like.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    /// Ideal planes.
    Boxes,
    /// Rough, curved, cluttered or with glass.
    Rough,
    /// Rays cast into a measured cloud.
    SemiReal,
}

/// One walk: everything that [`crate::simulate`] needs, with a name.
#[derive(Debug, Clone, PartialEq)]
pub struct CatalogueWalk {
    /// Lower case, unique, fit for a file name.
    pub name: String,
    /// What its building is like.
    pub group: Group,
    /// Building, route, gait and sensor.
    pub config: Config,
    /// The true rig.
    pub rig: Rig,
}

impl CatalogueWalk {
    fn named_after(mut self, series: u64) -> Self {
        if series > 0 {
            self.name = format!("{}_s{series}", self.name);
        }
        self
    }
}

/// One line of the table.
struct Line {
    name: &'static str,
    world: WorldKind,
    building: u64,
    seed: u64,
    gait: f64,
    speed: f64,
    turn: f64,
    zero: bool,
    /// Roll, pitch and yaw of the LiDAR, degrees.
    turned: [f64; 3],
    /// Lever arm, metres.
    arm: [f64; 3],
    roughness: Option<f64>,
}

impl Line {
    const fn new(name: &'static str, world: WorldKind, building: u64, seed: u64) -> Self {
        Self {
            name,
            world,
            building,
            seed,
            gait: 1.0,
            speed: 1.1,
            turn: 85.0,
            zero: true,
            turned: [0.0; 3],
            arm: [0.0; 3],
            roughness: None,
        }
    }

    /// Scale of the gait, walking speed in m/s, peak rate of turns in degrees/s.
    const fn moved(self, gait: f64, speed: f64, turn: f64) -> Self {
        Self { gait, speed, turn, ..self }
    }

    const fn mounted(self, turned: [f64; 3], arm: [f64; 3]) -> Self {
        Self { turned, arm, ..self }
    }

    const fn roughened(self, metres: f64) -> Self {
        Self { roughness: Some(metres), ..self }
    }

    /// The gyroscope's bias and noise stay in the data.
    const fn open_gyro(self) -> Self {
        Self { zero: false, ..self }
    }

    fn walk(&self, group: Group) -> CatalogueWalk {
        let config = Config {
            world: self.world,
            building: self.building,
            roughness_m: self.roughness,
            seed: self.seed,
            gait: self.gait,
            speed_m_s: self.speed,
            turn_rate_dps: self.turn,
            auto_zero: self.zero,
            ..Config::default()
        };
        let mut rig = Rig::default();
        rig.imu_from_lidar.translation_m = self.arm;
        rig.imu_from_lidar.roll_pitch_yaw_deg = self.turned;
        CatalogueWalk { name: self.name.to_owned(), group, config, rig }
    }
}

/// All walks through worlds that need no data, boxes first. Every walk begins with at least three seconds of standing.
///
/// A series above 0 has other buildings of the same kinds, other noise, and gaits and rigs in another order: walks that nothing was
/// tuned on. Their names end with the series.
pub fn catalogue(series: u64) -> Vec<CatalogueWalk> {
    let boxes = in_series(boxes(), series).into_iter().map(|line| line.walk(Group::Boxes));
    let rough = in_series(rough(), series).into_iter().map(|line| line.walk(Group::Rough));
    boxes.chain(rough).map(|walk| walk.named_after(series)).collect()
}

fn in_series(lines: Vec<Line>, series: u64) -> Vec<Line> {
    let count = lines.len();
    let other = |index: usize, step: u64| &lines[(index + (step * series) as usize) % count];
    let line = |(index, line): (usize, &Line)| {
        let (moved, mounted) = (other(index, 1), other(index, 3));
        Line {
            building: line.building + BUILDINGS_A_SERIES * series,
            seed: line.seed + SEEDS_A_SERIES * series,
            gait: moved.gait,
            speed: moved.speed,
            turn: moved.turn,
            zero: moved.zero,
            turned: mounted.turned,
            arm: mounted.arm,
            ..*line
        }
    };
    lines.iter().enumerate().map(line).collect()
}

/// No two series share a building or a seed.
const BUILDINGS_A_SERIES: u64 = 20;
const SEEDS_A_SERIES: u64 = 1000;

/// Two walks with rays cast into the map of a long hall that a real Mid-40 measured (`corner.pcd` and `surf.pcd` of
/// `livox_relocalization`), or none where the folder does not hold it.
///
/// A series above 0 has other noise, see [`catalogue`].
pub fn semi_real(cloud_folder: &Path, series: u64) -> Vec<CatalogueWalk> {
    let clouds: Vec<PathBuf> = ["surf.pcd", "corner.pcd"].map(|name| cloud_folder.join(name)).into();
    if !clouds.iter().all(|path| path.is_file()) {
        return Vec::new();
    }
    // About 1 m above the floor along the path that was measured, which sinks towards the far end.
    let there = vec![[0.0, 0.5, 0.45], [38.0, 0.2, 0.15], [38.0, 4.8, -0.05], [20.0, 5.0, 0.05]];
    let back = vec![[50.0, 4.8, -0.15], [10.0, 5.0, 0.15], [10.0, 0.5, 0.35], [35.0, 0.2, 0.2]];
    let lines = [
        (
            Line::new("measured_hall_1", WorldKind::SemiReal, 1, 301)
                .mounted([1.0, -0.5, 2.0], [0.05, -0.02, 0.06]),
            there,
        ),
        (
            Line::new("measured_hall_2", WorldKind::SemiReal, 1, 302)
                .moved(1.5, 1.2, 110.0)
                .mounted([-2.0, 3.0, -1.0], [0.1, 0.0, -0.05])
                .open_gyro(),
            back,
        ),
    ];
    let walk = |(line, way): (Line, Vec<[f64; 3]>)| {
        let mut walk = line.walk(Group::SemiReal);
        walk.config.clouds.clone_from(&clouds);
        walk.config.way_points_m = way;
        walk.config.seed += SEEDS_A_SERIES * series;
        walk.named_after(series)
    };
    lines.into_iter().map(walk).collect()
}

fn boxes() -> Vec<Line> {
    use WorldKind::{FloorPlan, Hall, Ramp, Shaft, Stairwell};
    vec![
        Line::new("plan_1", FloorPlan, 1, 101).mounted([1.0, -0.5, 2.0], [0.05, -0.02, 0.06]),
        Line::new("plan_2", FloorPlan, 2, 102)
            .moved(0.0, 0.9, 60.0)
            .mounted([-2.0, 3.0, -1.0], [0.10, 0.04, -0.05])
            .open_gyro(),
        Line::new("plan_3", FloorPlan, 3, 103)
            .moved(1.5, 1.2, 110.0)
            .mounted([0.5, 1.5, 5.0], [0.0, 0.08, 0.12]),
        Line::new("plan_4", FloorPlan, 4, 104)
            .moved(0.5, 1.0, 75.0)
            .mounted([-5.0, -1.0, 0.5], [-0.06, 0.0, 0.15])
            .open_gyro(),
        Line::new("plan_5", FloorPlan, 5, 105)
            .moved(2.0, 1.3, 130.0)
            .mounted([2.0, 2.0, -2.0], [0.03, -0.10, 0.02]),
        Line::new("plan_6", FloorPlan, 6, 106)
            .moved(1.0, 1.1, 50.0)
            .mounted([0.0, -5.0, 1.0], [0.15, 0.0, 0.0])
            .open_gyro(),
        Line::new("plan_7", FloorPlan, 7, 107)
            .moved(0.8, 1.2, 95.0)
            .mounted([3.0, 0.0, -4.0], [0.02, 0.05, -0.08]),
        Line::new("plan_8", FloorPlan, 8, 108).moved(1.2, 1.1, 120.0).open_gyro(),
        Line::new("plan_9", FloorPlan, 9, 109)
            .moved(0.3, 1.0, 90.0)
            .mounted([-1.0, 4.0, 3.0], [0.08, -0.08, 0.08]),
        Line::new("plan_10", FloorPlan, 10, 110)
            .moved(1.6, 1.0, 100.0)
            .mounted([1.5, -2.5, 0.0], [-0.04, 0.02, 0.1])
            .open_gyro(),
        Line::new("ramp_1", Ramp, 1, 111).moved(1.0, 1.1, 85.0).mounted([0.0, 2.0, 1.0], [0.06, 0.0, 0.1]),
        Line::new("shaft_1", Shaft, 1, 112)
            .moved(0.7, 1.2, 105.0)
            .mounted([-3.0, -1.5, 1.0], [0.0, 0.06, -0.1])
            .open_gyro(),
        Line::new("stairs_1", Stairwell, 1, 113)
            .moved(1.3, 0.9, 95.0)
            .mounted([1.0, 3.5, -2.0], [0.07, -0.03, 0.05]),
        Line::new("station_1", Hall, 1, 114)
            .moved(1.4, 1.3, 115.0)
            .mounted([2.0, 0.0, 4.0], [0.1, 0.1, 0.0])
            .open_gyro(),
    ]
}

fn rough() -> Vec<Line> {
    use WorldKind::{Atrium, FloorPlan, Office, OpenHall, Plant, Rough, Tunnel};
    vec![
        Line::new("cellar_11", Rough, 11, 201).mounted([1.0, -0.5, 2.0], [0.05, -0.02, 0.06]),
        Line::new("cellar_12", Rough, 12, 202)
            .moved(1.5, 1.0, 110.0)
            .mounted([-2.0, 1.0, -3.0], [0.1, 0.0, 0.1])
            .open_gyro(),
        Line::new("uneven_13", FloorPlan, 13, 203).moved(0.5, 1.2, 80.0).roughened(0.012),
        Line::new("uneven_14", FloorPlan, 14, 204)
            .moved(1.0, 1.1, 95.0)
            .mounted([0.5, 5.0, 1.0], [0.0, 0.1, -0.05])
            .roughened(0.025)
            .open_gyro(),
        Line::new("tunnel_1", Tunnel, 1, 205)
            .moved(1.2, 1.1, 90.0)
            .mounted([2.0, 1.0, 0.0], [0.05, 0.05, 0.05]),
        Line::new("tunnel_2", Tunnel, 2, 206)
            .moved(0.6, 1.3, 120.0)
            .mounted([0.0, -3.0, 4.0], [0.0, -0.1, 0.1])
            .open_gyro(),
        Line::new("plant_1", Plant, 1, 207).moved(1.0, 1.0, 85.0).mounted([-1.0, 2.0, 1.0], [0.1, 0.05, 0.0]),
        Line::new("plant_2", Plant, 2, 208).moved(1.8, 1.2, 110.0).open_gyro(),
        Line::new("office_1", Office, 1, 209)
            .moved(0.7, 1.1, 70.0)
            .mounted([0.5, -1.5, 3.0], [0.05, 0.0, 0.12]),
        Line::new("office_2", Office, 2, 210)
            .moved(1.0, 1.0, 100.0)
            .mounted([4.0, 0.0, -1.0], [-0.05, 0.03, 0.04])
            .open_gyro(),
        Line::new("atrium_1", Atrium, 1, 211)
            .moved(1.0, 1.2, 85.0)
            .mounted([1.0, 1.0, -5.0], [0.0, 0.0, 0.1]),
        Line::new("open_hall_1", OpenHall, 1, 212)
            .moved(1.0, 1.3, 85.0)
            .mounted([0.0, 2.0, 1.0], [0.06, 0.0, 0.1])
            .open_gyro(),
    ]
}

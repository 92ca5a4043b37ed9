//! The walks that experiments are made on, by name, before they are in memory.

use std::path::{Path, PathBuf};

use evac_config::ImuFromLidar;
use evac_simulator::{Config, WorldKind};
use evac_stage::Rig;

use crate::{ExperimentError, Walk, read_recording, simulated};

/// Which limits a walk is held to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Group {
    /// The three recorded walks of the test data.
    Recorded,
    /// Buildings of flat walls.
    Boxes,
    /// Rough and cluttered buildings, and rays cast into a measured cloud.
    Rough,
}

impl Group {
    /// All groups in the order of the tables.
    pub const ALL: [Self; 3] = [Self::Recorded, Self::Boxes, Self::Rough];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Recorded => "recorded",
            Self::Boxes => "boxes",
            Self::Rough => "rough",
        }
    }
}

/// A walk that can be loaded.
#[derive(Debug, Clone)]
pub struct Source {
    /// Name in tables and for `--only`.
    pub name: String,
    /// Its group.
    pub group: Group,
    kind: Kind,
}

#[derive(Debug, Clone)]
enum Kind {
    Recording(PathBuf),
    Simulation(Box<(Config, Rig)>),
}

impl Source {
    /// Reads or simulates the walk; `duration_s` ends it early.
    ///
    /// # Errors
    /// Those of [`read_recording`] and [`simulated`].
    pub fn load(&self, duration_s: Option<f64>) -> Result<Walk, ExperimentError> {
        let mut walk = match &self.kind {
            Kind::Recording(folder) => read_recording(&self.name, folder)?,
            Kind::Simulation(simulation) => {
                let (config, rig) = simulation.as_ref();
                let shorter = duration_s.into_iter().chain(config.duration_s).reduce(f64::min);
                simulated(&self.name, &Config { duration_s: shorter, ..config.clone() }, rig)?
            }
        };
        if let Some(duration_s) = duration_s {
            let frames =
                (0..walk.frames.len()).take_while(|index| walk.seconds(*index) <= duration_s + 1e-6).count();
            if frames < walk.frames.len() {
                let imu = walk.imu();
                walk.frames.truncate(frames);
                walk = walk.with_imu(&imu);
            }
        }
        Ok(walk)
    }
}

/// The recorded walks below the folder of test data; those that are not there are left out.
pub fn recorded(data: &Path) -> Vec<Source> {
    ["corridor", "hall", "shake"]
        .into_iter()
        .map(|name| (name, data.join("simulated").join(name)))
        .filter(|(_, folder)| folder.is_dir())
        .map(|(name, folder)| Source {
            name: format!("recorded-{name}"),
            group: Group::Recorded,
            kind: Kind::Recording(folder),
        })
        .collect()
}

/// The simulated walks.
pub fn catalogue() -> Vec<Source> {
    let worlds =
        [("corridor", WorldKind::Corridor), ("hall", WorldKind::Hall), ("stairwell", WorldKind::Stairwell)];
    let mut sources = Vec::new();
    for seed in 21..=24 {
        for (name, world) in worlds {
            let config = Config { world, seed, gait: 0.5 + 0.4 * (seed - 21) as f64, ..Config::default() };
            let tilt = seed as f64 - 22.5;
            let imu_from_lidar = ImuFromLidar {
                translation_m: [0.04, -0.03, 0.05],
                roll_pitch_yaw_deg: [0.5 * tilt, -0.8 * tilt, 1.5 * tilt],
            };
            sources.push(Source {
                name: format!("{name}-{seed}"),
                group: Group::Boxes,
                kind: Kind::Simulation(Box::new((config, Rig { imu_from_lidar }))),
            });
        }
    }
    sources
}

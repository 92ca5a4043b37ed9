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

/// The simulated walks: the simulator's three built worlds, its catalogue, and rays cast into the measured hall where the folder of
/// test data holds it. A `series` above 0 has other buildings, noise, gaits and rigs, see [`evac_simulator::catalogue`].
pub fn catalogue(data: &Path, series: u64) -> Vec<Source> {
    let rig = Rig {
        imu_from_lidar: ImuFromLidar {
            translation_m: [0.05, -0.02, 0.06],
            roll_pitch_yaw_deg: [0.5, -1.0, 1.5],
        },
    };
    let built = [
        ("corridor_21", Config { world: WorldKind::Corridor, seed: 21, ..Config::default() }),
        ("hall_22", Config { world: WorldKind::Hall, seed: 22, ..Config::default() }),
        ("stairwell_23", Config { world: WorldKind::Stairwell, seed: 23, ..Config::default() }),
    ];
    let built = built.into_iter().map(|(name, config)| Source {
        name: if series > 0 { format!("{name}_s{series}") } else { name.to_owned() },
        group: Group::Boxes,
        kind: Kind::Simulation(Box::new((Config { seed: config.seed + 100 * series, ..config }, rig))),
    });
    let measured = evac_simulator::semi_real(&data.join("real/livox_mid40_hall_map"), series);
    let drawn = evac_simulator::catalogue(series).into_iter().chain(measured).map(|walk| Source {
        name: walk.name,
        group: if walk.group == evac_simulator::Group::Boxes { Group::Boxes } else { Group::Rough },
        kind: Kind::Simulation(Box::new((walk.config, walk.rig))),
    });
    built.chain(drawn).collect()
}

//! Configuration of the map saver.

use std::path::PathBuf;

use evac_stage::{StageConfig, check_range};
use serde::{Deserialize, Serialize};

/// Where files go and how much is kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MapSaverConfig {
    /// Folder for `map.ot`, `map.bt`, `cloud.pcd`, `trajectory.tum` and `truth.tum`; it is created.
    pub output_dir: PathBuf,
    /// Seconds of sensor time between two savings, 0 for the end of the stream only. A power cut loses at most this
    /// much; a saving writes everything anew, about a second for a large building.
    pub save_interval_s: f64,
    /// Edge of the cells of which `cloud.pcd` keeps the first point, metres. 0.05 m is a little over the noise of a
    /// Mid-40 (2 cm) and keeps a door's frame apart from its leaf.
    pub cloud_voxel_m: f64,
    /// Most points of the cloud; points of further cells are counted as rejected. 10 million, 4,000 square metres of
    /// floor, walls and ceiling at 0.05 m each way and more, take about 350 MB.
    pub max_cloud_points: u32,
    /// Most poses of a trajectory, for later frames none is kept and they count as degraded. 2 million are 55 hours at
    /// 10 Hz.
    pub max_poses: u32,
    /// Memory of the map, MiB; voxels for which there is no room are counted as rejected. As the mapper's.
    pub max_map_mib: f64,
    /// Probability from which a voxel is occupied in `map.bt`. 0.5 as OctoMap and the mapper have it.
    pub occupied_probability: f64,
}

impl Default for MapSaverConfig {
    fn default() -> Self {
        Self {
            output_dir: PathBuf::from("evac-out"),
            save_interval_s: 60.0,
            cloud_voxel_m: 0.05,
            max_cloud_points: 10_000_000,
            max_poses: 2_000_000,
            max_map_mib: 256.0,
            occupied_probability: 0.5,
        }
    }
}

impl StageConfig for MapSaverConfig {
    fn check(&self) -> Result<(), String> {
        check_range("save_interval_s", self.save_interval_s, 0.0, 86_400.0, "0 saves at the end only")?;
        check_range(
            "cloud_voxel_m",
            self.cloud_voxel_m,
            0.001,
            10.0,
            "0.05 is a little over a Mid-40's noise",
        )?;
        check_range("max_map_mib", self.max_map_mib, 0.0625, 65_536.0, "as the mapper's")?;
        check_range("occupied_probability", self.occupied_probability, 0.01, 0.99, "0.5 is OctoMap's")?;
        for (key, value) in [("max_cloud_points", self.max_cloud_points), ("max_poses", self.max_poses)] {
            if value == 0 {
                return Err(format!(
                    "{key} = 0 keeps nothing; give at least 1, or leave it out for the default"
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_sound_and_survives_toml() {
        let config = MapSaverConfig::default();
        assert_eq!(config.check(), Ok(()));
        assert_eq!(toml::from_str::<MapSaverConfig>(&toml::to_string(&config).unwrap()).unwrap(), config);
    }

    #[test]
    fn unknown_keys_and_bad_ranges_are_refused_by_name() {
        assert!(toml::from_str::<MapSaverConfig>("cloud = 1").unwrap_err().to_string().contains("cloud"));
        for text in
            ["cloud_voxel_m = 0.0", "save_interval_s = nan", "max_poses = 0", "occupied_probability = 1.0"]
        {
            let error = toml::from_str::<MapSaverConfig>(text).unwrap().check().unwrap_err();
            assert!(error.starts_with(text.split(' ').next().unwrap()), "{error}");
        }
    }
}

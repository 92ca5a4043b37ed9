//! Configuration of the grid exporter.

use std::path::PathBuf;

use evac_formats::occupancy_grid;
use evac_stage::{StageConfig, check_range};
use serde::{Deserialize, Serialize};

/// What the plan shows and where it goes. Heights are above the local ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GridExporterConfig {
    /// Folder for `plan.pgm`, `plan.yaml`, `plan.png` and what else there is, see the crate; it is created.
    pub output_dir: PathBuf,
    /// How cells become grey, as in nav2: `trinary` (PGM: black, white, grey for unknown), `raw` (PGM of the values 0, 100 and
    /// 255 for unknown), or `scale` (`plan_scale.png`, unknown transparent). `plan.yaml` names mode and picture.
    pub mode: Mode,
    /// Least time between two plans on `grid/plan`, seconds of sensor time; 0 publishes with each frame that changes the plan.
    /// Projecting costs what has changed, but a message holds the whole plan: a millisecond for a million cells.
    pub publish_interval_s: f64,
    /// Seconds of sensor time between two savings of the files, 0 for the end of the stream only. A power cut loses at
    /// most this much.
    pub save_interval_s: f64,
    /// Lower and upper end of the height band in metres: what a person or a robot would bump into. Below 0.2 m lie
    /// thresholds and the noise of the ground, above 1.8 m lamps, door frames and the ceiling.
    pub band_m: [f64; 2],
    /// Projects as `octomap_server` does its `projected_map`: between these heights in the map frame, metres (its
    /// `occupancy_min_z` and `occupancy_max_z`), any occupied voxel makes a cell occupied, else any free one free. No ground, no
    /// storeys, and none of what follows but the limits. Absent: all heights are above the local ground.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fixed_z_m: Option<[f64; 2]>,
    /// A cell is occupied when at least one occupied voxel of the band stands in it and this many in it and its eight
    /// neighbours together. 2 keeps walls, low boxes and thin posts. A cell with fewer, a stray point or a wire, is unknown.
    pub min_occupied_voxels: u32,
    /// A cell without seen ground is free when this many free voxels were seen in it from the band's lower end up to
    /// `seen_down_to_m`: 2, so that a single ray does not decide.
    pub min_free_voxels: u32,
    /// How near to the floor a cell without seen ground must have been seen through, metres. What is lower than this and
    /// seen over may hide there, so 0.5 is less than a table, a planter or a parapet.
    pub seen_down_to_m: f64,
    /// Free cells in a gap narrower than this between two obstacles are closed, metres. Nobody passes through 0.3 m; the
    /// gaps are mostly places where few rays hit the top of a bench or a step.
    pub min_gap_m: f64,
    /// A voxel counts as occupied from this probability on. 0.5 as OctoMap and the mapper have it.
    pub occupied_probability: f64,
    /// Height of the LiDAR above the ground in metres, used until enough ground was seen under the path to measure it.
    /// 1.2 m is a sensor carried at the hip or on a small robot.
    pub sensor_height_m: f64,
    /// Largest change of the ground's height in metres between two places 0.5 m apart that still is the same storey. 0.4:
    /// kerbs, two steps and stairs up to 38 degrees pass, another storey or the edge of a platform (0.55 m and more) does
    /// not.
    pub max_step_m: f64,
    /// Unknown border around the known area, metres, for planners that need one.
    pub margin_m: f64,
    /// Longest side of the plan in cells around the first position; what lies beyond is dropped and counted. 8192 cells
    /// are 819 m at 0.1 m, and 64 MiB on `grid/plan`.
    pub max_side_cells: u32,
    /// Ceiling of the memory for voxel columns, MiB; what does not fit is dropped and counted. One MiB holds 679 blocks
    /// of 8 x 8 columns x 64 voxels, so that 512 MiB suffice for 20,000 square metres at 0.1 m many times over. Each storey's plan takes half a block for each block's area besides.
    pub max_memory_mib: u32,
}

/// How cells become grey; see nav2's `map_saver` and `map_server`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Black, white, and grey for unknown.
    #[default]
    Trinary,
    /// Shades of grey, transparent for unknown.
    Scale,
    /// The values themselves.
    Raw,
}

impl From<Mode> for occupancy_grid::Mode {
    fn from(mode: Mode) -> Self {
        match mode {
            Mode::Trinary => Self::Trinary,
            Mode::Scale => Self::Scale,
            Mode::Raw => Self::Raw,
        }
    }
}

impl Default for GridExporterConfig {
    fn default() -> Self {
        Self {
            output_dir: PathBuf::from("evac-out"),
            mode: Mode::Trinary,
            publish_interval_s: 0.0,
            save_interval_s: 10.0,
            band_m: [0.2, 1.8],
            fixed_z_m: None,
            min_occupied_voxels: 2,
            min_free_voxels: 2,
            seen_down_to_m: 0.5,
            min_gap_m: 0.3,
            occupied_probability: 0.5,
            sensor_height_m: 1.2,
            max_step_m: 0.4,
            margin_m: 0.5,
            max_side_cells: 8192,
            max_memory_mib: 512,
        }
    }
}

impl StageConfig for GridExporterConfig {
    fn check(&self) -> Result<(), String> {
        let [low, high] = self.band_m;
        check_range(
            "publish_interval_s",
            self.publish_interval_s,
            0.0,
            3600.0,
            "0 publishes each change, 1.0 at most once a second",
        )?;
        check_range("save_interval_s", self.save_interval_s, 0.0, 86_400.0, "0 saves at the end only")?;
        check_range("band_m[0]", low, 0.0, 5.0, "0.2 lies above the noise of the ground")?;
        check_range("band_m[1]", high, 0.0, 10.0, "1.8 is a person's height")?;
        if low >= high {
            return Err(format!(
                "band_m = [{low}, {high}] is empty; give the lower end first, as in [0.2, 1.8]"
            ));
        }
        if let Some([low, high]) =
            self.fixed_z_m.filter(|[low, high]| low.is_nan() || high.is_nan() || low >= high)
        {
            return Err(format!(
                "fixed_z_m = [{low}, {high}] is empty; give the lower end first, as in [-1.0, 0.5]"
            ));
        }
        count("min_occupied_voxels", self.min_occupied_voxels, 1, 100)?;
        count("min_free_voxels", self.min_free_voxels, 1, 100)?;
        check_range("occupied_probability", self.occupied_probability, 0.01, 0.99, "0.5 is OctoMap's")?;
        check_range(
            "seen_down_to_m",
            self.seen_down_to_m,
            low,
            high,
            "0.5 is lower than a table; within band_m",
        )?;
        check_range("min_gap_m", self.min_gap_m, 0.0, 1.0, "0.3 is too narrow for anyone, 0 closes none")?;
        check_range(
            "sensor_height_m",
            self.sensor_height_m,
            0.0,
            10.0,
            "measure from the ground to the LiDAR",
        )?;
        check_range("max_step_m", self.max_step_m, 0.05, 2.0, "0.4 passes stairs and keeps platforms apart")?;
        check_range("margin_m", self.margin_m, 0.0, 100.0, "0.5 leaves a border of unknown")?;
        count("max_side_cells", self.max_side_cells, 64, 16_384)?;
        count("max_memory_mib", self.max_memory_mib, 1, 65_536)
    }
}

fn count(key: &str, value: u32, low: u32, high: u32) -> Result<(), String> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(format!("{key} = {value} is outside {low} to {high}; leave the key out for the default"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_sound_and_survives_toml() {
        let config = GridExporterConfig::default();
        assert_eq!(config.check(), Ok(()));
        assert_eq!(toml::from_str::<GridExporterConfig>(&toml::to_string(&config).unwrap()).unwrap(), config);
    }

    #[test]
    fn unknown_keys_and_bad_ranges_are_refused_by_name() {
        assert!(toml::from_str::<GridExporterConfig>("bands = 1").unwrap_err().to_string().contains("bands"));
        for text in [
            "band_m = [1.8, 0.2]",
            "fixed_z_m = [1.0, 1.0]",
            "sensor_height_m = nan",
            "min_free_voxels = 0",
            "margin_m = -1.0",
        ] {
            let config: GridExporterConfig = toml::from_str(text).unwrap();
            let error = config.check().unwrap_err();
            let key = text.split([' ', '[']).next().unwrap();
            assert!(error.starts_with(key), "{error}");
        }
    }
}

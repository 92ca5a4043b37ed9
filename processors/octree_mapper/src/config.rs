//! The mapper's configuration: every default with its unit and reason.

use evac_octree::{MapConfig, Probabilities, SensorModel};
use evac_stage::{StageConfig, check_range};
use serde::{Deserialize, Serialize};

use crate::{BoundsConfig, GroundConfig, OutlierConfig, UnseenConfig};

/// Configuration of the octree mapper.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OctreeMapperConfig {
    /// Edge of the finest voxel, metres. 0.1: a door of 0.8 m stays open by 6 free voxels, and a key frame of a
    /// Mid-40 costs 10 ms in a corridor and 30 ms in a hall.
    pub resolution_m: f64,
    /// Farthest place that a hit may occupy, metres; the ray of a farther point only clears up to here. 30: beyond it
    /// neighbouring points of one Mid-40 frame lie about two voxels apart, and a heading error of 0.2 degrees is a voxel.
    pub max_range_m: f64,
    /// Memory of the map, MiB. 256: at 0.1 m a station of 300 m x 150 m x 12 m seen whole. From seven eighths on no new place
    /// is taken in, what is in the map keeps being updated, and scans of which a part does not fit count as degraded.
    pub max_map_mib: f64,
    /// Whether scans of an odometry that is still initialising go into the map. Off: their pose is the identity, which
    /// misses the tilt of the mount until gravity is known, and the walker stands still so that nothing is lost.
    pub map_while_initialising: bool,
    /// Threads that cast the rays of a key frame, 1 to 8; the map is the same with any number. 1: a Mid-40's key frame at 0.1 m
    /// needs no more, and the other stages want the other cores. 2 suit 0.05 m and sensors that see all around.
    pub threads: u32,
    /// Clears blocks of 4 x 4 x 4 voxels instead of voxels along the rays: several times faster, and not OctoMap's result. Thin things
    /// beside a ray are cleared with it. For computers that cannot keep up otherwise.
    pub coarse_free_space: bool,
    /// Places that were not seen again.
    pub unseen: UnseenConfig,
    /// Probabilities of the occupancy model, paper Eq. 7-10.
    pub occupancy: OccupancyConfig,
    /// When a scan goes into the map, paper section 3.2.
    pub key_frames: KeyFrameConfig,
    /// Radius outlier removal, paper section 3.1 (1).
    pub outliers: OutlierConfig,
    /// Conditional filter, paper section 3.1 (2).
    pub bounds: BoundsConfig,
    /// Ground filter, paper section 3.1 (3).
    pub ground: GroundConfig,
}

impl Default for OctreeMapperConfig {
    fn default() -> Self {
        Self {
            resolution_m: 0.1,
            max_range_m: 30.0,
            max_map_mib: 256.0,
            map_while_initialising: false,
            threads: 1,
            coarse_free_space: false,
            unseen: UnseenConfig::default(),
            occupancy: OccupancyConfig::default(),
            key_frames: KeyFrameConfig::default(),
            outliers: OutlierConfig::default(),
            bounds: BoundsConfig::default(),
            ground: GroundConfig::default(),
        }
    }
}

impl OctreeMapperConfig {
    /// What the octree is built with.
    ///
    /// # Errors
    /// One sentence about the probabilities that do not fit together.
    pub fn map_config(&self) -> Result<MapConfig, String> {
        let sensor =
            SensorModel::from_probabilities(&self.occupancy.probabilities()).map_err(|e| e.to_string())?;
        let max_bytes = (self.max_map_mib * f64::from(1 << 20)) as usize;
        Ok(MapConfig { sensor, max_bytes, threads: self.threads, ..MapConfig::new(self.resolution_m) })
    }
}

impl StageConfig for OctreeMapperConfig {
    fn check(&self) -> Result<(), String> {
        check_range("resolution_m", self.resolution_m, 0.01, 10.0, "0.05 to 0.4 m suit buildings")?;
        check_range("max_range_m", self.max_range_m, 1.0, 500.0, "30 m suits a Mid-40 indoors")?;
        check_range("max_map_mib", self.max_map_mib, 0.0625, 65_536.0, "256 MiB suit a station at 0.1 m")?;
        check_range("threads", f64::from(self.threads), 1.0, 8.0, "1 suits a Mid-40 at 0.1 m")?;
        self.unseen.check()?;
        self.map_config()?;
        self.key_frames.check()?;
        self.outliers.check()?;
        self.bounds.check()?;
        self.ground.check()
    }
}

/// `occupancy`: probabilities as OctoMap names them; the defaults are OctoMap's, so maps compare with other people's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OccupancyConfig {
    /// Probability that a voxel with a hit is occupied, 0.5 to 1.
    pub hit: f64,
    /// Probability that a voxel that a ray crossed is occupied, 0 to 0.5.
    pub miss: f64,
    /// Lowest probability a voxel can reach: bounds how long a closed door takes to appear.
    pub clamp_min: f64,
    /// Highest probability a voxel can reach: bounds how long a person who left stays in the map.
    pub clamp_max: f64,
    /// Probability from which a voxel counts as occupied.
    pub occupied: f64,
}

impl Default for OccupancyConfig {
    fn default() -> Self {
        let Probabilities { hit, miss, clamp_min, clamp_max, occupied } = Probabilities::default();
        Self { hit, miss, clamp_min, clamp_max, occupied }
    }
}

impl OccupancyConfig {
    fn probabilities(&self) -> Probabilities {
        let Self { hit, miss, clamp_min, clamp_max, occupied } = *self;
        Probabilities { hit, miss, clamp_min, clamp_max, occupied }
    }
}

/// `key_frames`: a scan goes into the map when any of the three limits since the last key frame is reached.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct KeyFrameConfig {
    /// Way of the LiDAR, metres. 0.25: every 2nd or 3rd frame of a walk at 1.2 m/s; the view has moved by more than
    /// two voxels, so that each key frame sees round edges that the last one did not.
    pub distance_m: f64,
    /// Rotation of the LiDAR, degrees. 8: a fifth of the 38.4 degree cone is new.
    pub angle_deg: f64,
    /// Time, seconds. 0.5: the Mid-40's rosette never repeats, so even at rest half a second fills in other
    /// directions; and people who have walked on are cleared (a voxel of six hits is free again after some ten
    /// crossing scans, 5 s).
    pub interval_s: f64,
}

impl Default for KeyFrameConfig {
    fn default() -> Self {
        Self { distance_m: 0.25, angle_deg: 8.0, interval_s: 0.5 }
    }
}

impl KeyFrameConfig {
    fn check(&self) -> Result<(), String> {
        check_range(
            "key_frames.distance_m",
            self.distance_m,
            0.0,
            100.0,
            "0 takes every scan, 0.25 m is usual",
        )?;
        check_range(
            "key_frames.angle_deg",
            self.angle_deg,
            0.0,
            180.0,
            "0 takes every scan, 8 degrees is usual",
        )?;
        check_range(
            "key_frames.interval_s",
            self.interval_s,
            0.0,
            3600.0,
            "0 takes every scan, 0.5 s is usual",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_valid_and_survive_toml() {
        let config = OctreeMapperConfig::default();
        config.check().unwrap();
        let text = toml::to_string(&config).unwrap();
        assert_eq!(toml::from_str::<OctreeMapperConfig>(&text).unwrap(), config);
    }

    #[test]
    fn an_unknown_key_is_refused_by_name() {
        let error = toml::from_str::<OctreeMapperConfig>("resolution = 0.1").unwrap_err();
        assert!(error.to_string().contains("unknown field `resolution`"), "{error}");
        assert!(toml::from_str::<OctreeMapperConfig>("[ground]\ncell = 1").is_err());
    }

    #[test]
    fn a_bad_value_is_named_with_its_range() {
        let cases = [
            ("resolution_m = 0.0", "resolution_m = 0"),
            ("resolution_m = nan", "resolution_m = NaN"),
            ("max_map_mib = 0", "max_map_mib = 0"),
            ("[bounds]\nz_m = [2.0, 1.0]", "bounds.z_m = [2, 1]"),
            ("[bounds]\nmin_range_m = 5.0\nmax_range_m = 4.0", "bounds.min_range_m = 5"),
            ("[ground]\nmin_points = 2", "ground.min_points = 2"),
            ("threads = 0", "threads = 0"),
            ("[unseen]\nafter_key_frames = 0", "unseen.after_key_frames = 0"),
            ("[unseen]\nfade_log_odds = -1.0", "unseen.fade_log_odds = -1"),
            ("[outliers]\nradius_m = 0.0", "outliers.radius_m = 0"),
            ("[outliers]\nmin_neighbours = 0", "outliers.min_neighbours = 0"),
            ("[key_frames]\nangle_deg = -1.0", "key_frames.angle_deg = -1"),
            ("[occupancy]\nhit = 0.3", "0.3"),
        ];
        for (text, part) in cases {
            let error = toml::from_str::<OctreeMapperConfig>(text).unwrap().check().unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}

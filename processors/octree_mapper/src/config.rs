//! The mapper's configuration: every default with its unit and reason.

use evac_octree::{MapConfig, Probabilities, SensorModel};
use evac_stage::StageConfig;
use serde::{Deserialize, Serialize};

use crate::check::{positive, range, within};

/// Configuration of the octree mapper.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OctreeMapperConfig {
    /// Edge of the finest voxel, metres. 0.1: a door of 0.8 m stays open by 6 free voxels, and a Mid-40 frame costs
    /// about 10 ms.
    pub resolution_m: f64,
    /// Farthest place that a hit may occupy, metres; the ray of a farther point only clears up to here. 30: beyond it
    /// neighbouring points of one Mid-40 frame lie more than two voxels apart and heading errors exceed a voxel.
    pub max_range_m: f64,
    /// Most bricks of 8 x 8 x 8 voxels. 262,144: at 0.1 m a station of 150 m x 75 m x 12 m seen whole, in 0.6 GB. Scans
    /// of which a part does not fit count as degraded.
    pub max_bricks: u32,
    /// Whether scans of an odometry that is still initialising go into the map. Off: their pose is the identity, which
    /// misses the tilt of the mount until gravity is known, and the walker stands still so that nothing is lost.
    pub map_while_initialising: bool,
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
            max_bricks: 262_144,
            map_while_initialising: false,
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
        Ok(MapConfig { sensor, max_bricks: self.max_bricks, ..MapConfig::new(self.resolution_m) })
    }
}

impl StageConfig for OctreeMapperConfig {
    fn check(&self) -> Result<(), String> {
        within("resolution_m", self.resolution_m, 0.01, 10.0, "0.05 to 0.4 m suit buildings")?;
        within("max_range_m", self.max_range_m, 1.0, 500.0, "30 m suits a Mid-40 indoors")?;
        if self.max_bricks == 0 {
            return Err("max_bricks = 0 leaves no room for a map; give at least 1, for example 262144".into());
        }
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
        within("key_frames.distance_m", self.distance_m, 0.0, 100.0, "0 takes every scan, 0.25 m is usual")?;
        within("key_frames.angle_deg", self.angle_deg, 0.0, 180.0, "0 takes every scan, 8 degrees is usual")?;
        within("key_frames.interval_s", self.interval_s, 0.0, 3600.0, "0 takes every scan, 0.5 s is usual")
    }
}

/// `outliers`: a point goes when fewer than `min_neighbours` others lie within `radius_m + radius_per_m * range`.
///
/// The radius grows with the range because the spacing of the points does: 10,000 points in a 38.4 degree cone are
/// 6 mrad apart on average, 6 cm at 10 m and 24 cm at 40 m, more on walls seen at a grazing angle. A fixed radius that
/// removes strays at 3 m would remove every wall at 30 m.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutlierConfig {
    /// Whether the filter runs.
    pub enabled: bool,
    /// Radius at the sensor, metres. 0.05: 2.5 sigma of the 2 cm range noise, so that noise alone isolates no point.
    pub radius_m: f64,
    /// Growth of the radius, metres a metre. 0.025: four times the mean spacing of one frame; a wall that is seen head-on
    /// then shows about 50 neighbours, one seen at 6 degrees still 5. Beyond 40 m it grows no further.
    pub radius_per_m: f64,
    /// Fewest other points. 3: strays are 0.3 % of the shots and seldom come in pairs.
    pub min_neighbours: u32,
}

impl Default for OutlierConfig {
    fn default() -> Self {
        Self { enabled: true, radius_m: 0.05, radius_per_m: 0.025, min_neighbours: 3 }
    }
}

impl OutlierConfig {
    fn check(&self) -> Result<(), String> {
        within("outliers.radius_m", self.radius_m, 0.001, 10.0, "0.05 m suits 2 cm of range noise")?;
        within("outliers.radius_per_m", self.radius_per_m, 0.0, 0.2, "0.025 suits a Mid-40")?;
        if self.min_neighbours == 0 && self.enabled {
            return Err(
                "outliers.min_neighbours = 0 removes nothing; set outliers.enabled = false instead".into()
            );
        }
        Ok(())
    }
}

/// `bounds`: points outside are removed. Coordinates are those of the map frame (z against gravity, origin at the
/// first LiDAR pose, so the floor of the start is at about minus the sensor's height).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BoundsConfig {
    /// Lowest and highest x, metres; absent: all.
    pub x_m: Option<[f64; 2]>,
    /// Lowest and highest y, metres; absent: all.
    pub y_m: Option<[f64; 2]>,
    /// Lowest and highest z, metres; absent: all.
    pub z_m: Option<[f64; 2]>,
    /// Shortest range from the sensor, metres. 0.5: nearer are the housing, hands and the person who carries it.
    pub min_range_m: f64,
    /// Longest range from the sensor, metres. 100: the Mid-40 sees 90 m at 10 % reflectivity; farther returns are
    /// mostly ghosts. (Points beyond the map's `max_range_m` but nearer than this still clear their ray.)
    pub max_range_m: f64,
}

impl Default for BoundsConfig {
    fn default() -> Self {
        Self { x_m: None, y_m: None, z_m: None, min_range_m: 0.5, max_range_m: 100.0 }
    }
}

impl BoundsConfig {
    fn check(&self) -> Result<(), String> {
        for (name, limits) in [("bounds.x_m", self.x_m), ("bounds.y_m", self.y_m), ("bounds.z_m", self.z_m)] {
            if let Some(limits) = limits {
                range(name, limits)?;
            }
        }
        within("bounds.min_range_m", self.min_range_m, 0.0, 100.0, "0.5 m hides the walker's own body")?;
        within("bounds.max_range_m", self.max_range_m, 0.0, 1000.0, "100 m suits a Mid-40")?;
        if self.min_range_m >= self.max_range_m {
            return Err(format!(
                "bounds.min_range_m = {} must be less than bounds.max_range_m = {}",
                self.min_range_m, self.max_range_m
            ));
        }
        Ok(())
    }
}

/// `ground`: which surfaces are ground, by height, tilt and extent. See [`GroundFilter`](crate::GroundFilter).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GroundConfig {
    /// Whether the filter runs; without it the ground is an obstacle like any other.
    pub enabled: bool,
    /// Edge of the cells in which surfaces are looked for, metres. 0.25: less than the tread of a stair (0.28), and
    /// 3 x 3 cells hold 15 points of a floor 10 m away.
    pub cell_m: f64,
    /// Steepest ground, degrees. 10: wheelchair ramps go to 1:8 (7.1 degrees), the rest is for errors of the pose;
    /// stairs have 24 degrees and more.
    pub max_tilt_deg: f64,
    /// Smallest width of ground, metres, whichever way it lies. 0.9: less than a corridor or a landing (1.2), more than
    /// the tread of a stair, a desk (0.8) or a window-sill.
    pub min_extent_m: f64,
    /// Thickness of a surface, metres: points up to this far above or below the ground's local plane are ground.
    /// 0.08: four sigma of the range noise; what stands on the ground keeps all but its lowest 8 cm.
    pub thickness_m: f64,
    /// Smallest step between two surfaces, metres: cells whose heights differ by more are not one surface. 0.05: a
    /// kerb, a third of a stair's riser, more than twice the range noise.
    pub step_m: f64,
    /// Fewest points in 3 x 3 cells for a plane. 5: two more than define it.
    pub min_points: u32,
    /// Height of the sensor over the lowest point of the ground in view: least and most, metres. 0.4: higher are desks
    /// seen by a sensor carried at 1.1 m; 8: two storeys, for a view down a stairwell.
    pub below_sensor_m: [f64; 2],
    /// Least height of the room over a ground, metres, where the cloud comes without sensor position: tells the top of
    /// a floor slab from its underside. 1.8.
    pub headroom_m: f64,
    /// Table tops: heights over the ground beside them, metres, at which a small surface is furniture. 0.25 to 1.3;
    /// a half-landing lies at 1.5.
    pub furniture_height_m: [f64; 2],
    /// Longest furniture, metres. 4: a conference table; longer surfaces at that height are platforms.
    pub furniture_extent_m: f64,
}

impl Default for GroundConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            cell_m: 0.25,
            max_tilt_deg: 10.0,
            min_extent_m: 0.9,
            thickness_m: 0.08,
            step_m: 0.05,
            min_points: 5,
            below_sensor_m: [0.4, 8.0],
            headroom_m: 1.8,
            furniture_height_m: [0.25, 1.3],
            furniture_extent_m: 4.0,
        }
    }
}

impl GroundConfig {
    /// Checks ranges.
    ///
    /// # Errors
    /// One sentence naming the key, its value, the allowed range and what to try.
    pub fn check(&self) -> Result<(), String> {
        positive("ground.cell_m", self.cell_m, "0.25 m suits a Mid-40")?;
        within("ground.max_tilt_deg", self.max_tilt_deg, 0.1, 60.0, "10 degrees covers wheelchair ramps")?;
        positive("ground.min_extent_m", self.min_extent_m, "0.9 m is narrower than a corridor")?;
        positive("ground.thickness_m", self.thickness_m, "0.08 m suits 2 cm of range noise")?;
        positive("ground.step_m", self.step_m, "0.05 m is a kerb")?;
        if self.min_points < 3 {
            return Err(format!(
                "ground.min_points = {} defines no plane; give at least 3, 5 is usual",
                self.min_points
            ));
        }
        range("ground.below_sensor_m", self.below_sensor_m)?;
        positive("ground.headroom_m", self.headroom_m, "1.8 m is the height of a door")?;
        range("ground.furniture_height_m", self.furniture_height_m)?;
        within("ground.furniture_extent_m", self.furniture_extent_m, 0.0, 100.0, "0 switches the test off")
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
            ("max_bricks = 0", "max_bricks = 0"),
            ("[bounds]\nz_m = [2.0, 1.0]", "bounds.z_m = [2, 1]"),
            ("[bounds]\nmin_range_m = 5.0\nmax_range_m = 4.0", "bounds.min_range_m = 5"),
            ("[ground]\nmin_points = 2", "ground.min_points = 2"),
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

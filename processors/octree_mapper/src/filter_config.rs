//! Configuration of the three filters (paper section 3.1): every default with its unit and reason.

use evac_stage::check_range;
use serde::{Deserialize, Serialize};

use crate::check::{positive, range};

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
    pub(crate) fn check(&self) -> Result<(), String> {
        check_range("outliers.radius_m", self.radius_m, 0.001, 10.0, "0.05 m suits 2 cm of range noise")?;
        check_range("outliers.radius_per_m", self.radius_per_m, 0.0, 0.2, "0.025 suits a Mid-40")?;
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
    pub(crate) fn check(&self) -> Result<(), String> {
        for (name, limits) in [("bounds.x_m", self.x_m), ("bounds.y_m", self.y_m), ("bounds.z_m", self.z_m)] {
            if let Some(limits) = limits {
                range(name, limits)?;
            }
        }
        check_range("bounds.min_range_m", self.min_range_m, 0.0, 100.0, "0.5 m hides the walker's own body")?;
        check_range("bounds.max_range_m", self.max_range_m, 0.0, 1000.0, "100 m suits a Mid-40")?;
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
        check_range(
            "ground.max_tilt_deg",
            self.max_tilt_deg,
            0.1,
            60.0,
            "10 degrees covers wheelchair ramps",
        )?;
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
        check_range(
            "ground.furniture_extent_m",
            self.furniture_extent_m,
            0.0,
            100.0,
            "0 switches the test off",
        )
    }
}

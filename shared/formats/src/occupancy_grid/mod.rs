//! Flat maps as PGM + YAML, as `map_server` (ROS 1) and nav2 load and save them.
//!
//! A grid is stored as in `nav_msgs/OccupancyGrid`: row-major, row 0 at the lowest y, origin at the lower-left corner of
//! cell (0, 0). The picture's row 0 is its top, the highest y.
//!
//! We write `free_thresh: 0.196`, ROS 1's value, and not nav2's default of 0.25: an unknown cell is saved as grey 205,
//! which loads as an occupancy of 1 - 205/255 = 0.19608. Below 0.25 that would come back as *free*, and on an evacuation
//! map unknown must never become free.

mod image;
mod read;
mod write;
mod yaml;

pub use read::read;
pub use write::{write, write_as};

/// How occupancy becomes grey, and grey occupancy again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// Occupied, free, unknown.
    #[default]
    Trinary,
    /// Grey between the thresholds is an occupancy from 0 to 100. Unknown is transparent, so the picture is a PNG.
    Scale,
    /// The values themselves, 255 for unknown.
    Raw,
}

/// A flat map.
#[derive(Debug, Clone, PartialEq)]
pub struct OccupancyGrid {
    /// Cells along x.
    pub width: u32,
    /// Cells along y.
    pub height: u32,
    /// Edge of a cell, metres.
    pub resolution: f64,
    /// Lower-left corner of cell (0, 0) in the map frame: x and y in metres, yaw in radians.
    pub origin: [f64; 3],
    /// `width * height` cells, row-major from the lowest y: [`UNKNOWN`], or 0 (free) to 100 (occupied).
    pub cells: Vec<i8>,
}

/// Cell of which nothing is known.
pub const UNKNOWN: i8 = -1;
/// Cell known to be free.
pub const FREE: i8 = 0;
/// Cell known to be occupied.
pub const OCCUPIED: i8 = 100;

/// An occupancy above this loads as occupied.
const OCCUPIED_THRESH: f64 = 0.65;
/// An occupancy below this loads as free; see the module's text.
const FREE_THRESH: f64 = 0.196;

#[cfg(test)]
mod tests;

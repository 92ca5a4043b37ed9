//! `nav_msgs/OccupancyGrid`.

use super::pose::RosPose;
use super::wire::Encoding;
use super::writer::{Stamp, Writer};

/// What a grid's cells lie on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Edge of a cell, metres.
    pub resolution: f64,
    /// Lower-left corner of cell (0, 0), metres.
    pub origin: [f64; 2],
    /// Cells along x.
    pub width: u32,
    /// Cells along y.
    pub height: u32,
}

/// Appends a serialised message to `out`; `cells` are -1 unknown, 0 free to 100 occupied, row-major from the lowest y, as
/// bytes.
pub fn write_grid(out: &mut Vec<u8>, encoding: Encoding, header: &Stamp<'_>, grid: &Grid, cells: &[u8]) {
    let mut writer = Writer::new(out, encoding);
    writer.header(header);
    writer.time(header.stamp_ns);
    writer.f32(grid.resolution as f32);
    writer.u32(grid.width);
    writer.u32(grid.height);
    let [x, y] = grid.origin;
    RosPose { position: [x, y, 0.0], ..RosPose::IDENTITY }.write(&mut writer);
    writer.u32(cells.len() as u32);
    writer.raw(cells);
}

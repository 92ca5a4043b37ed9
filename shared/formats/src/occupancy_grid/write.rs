//! Saves a flat map as nav2's map saver does in trinary mode.

use std::io::{self, Write};
use std::path::Path;

use super::{FREE_THRESH, OCCUPIED_THRESH, OccupancyGrid};
use crate::{FormatError, write_atomically};

const GREY_OCCUPIED: u8 = 0;
const GREY_UNKNOWN: u8 = 205;
const GREY_FREE: u8 = 254;

/// Writes `yaml_path` and a picture of the same name with the ending `.pgm`, each whole or not at all, the picture first.
///
/// Numbers are written with every digit they need (nav2's own saver cuts the origin to three significant digits).
///
/// # Errors
/// [`FormatError::Io`] naming the file; also where the grid's numbers do not fit together.
pub fn write(yaml_path: &Path, grid: &OccupancyGrid) -> Result<(), FormatError> {
    let picture_path = yaml_path.with_extension("pgm");
    let picture_name = picture_path.file_name().unwrap_or_default().to_string_lossy();
    write_atomically(&picture_path, |writer| write_picture(writer, grid))?;
    write_atomically(yaml_path, |writer| write_yaml(writer, grid, &picture_name))
}

fn write_picture(writer: &mut impl Write, grid: &OccupancyGrid) -> io::Result<()> {
    check(grid)?;
    write!(
        writer,
        "P5\n# CREATOR: evac {:.3} m/pix\n{} {}\n255\n",
        grid.resolution, grid.width, grid.height
    )?;
    for row in grid.cells.chunks_exact(grid.width as usize).rev() {
        for cell in row {
            writer.write_all(&[grey(*cell)])?;
        }
    }
    Ok(())
}

fn write_yaml(writer: &mut impl Write, grid: &OccupancyGrid, picture: &str) -> io::Result<()> {
    let [x, y, yaw] = grid.origin.map(decimal);
    writeln!(writer, "image: {picture}")?;
    writeln!(writer, "mode: trinary")?;
    writeln!(writer, "resolution: {}", decimal(grid.resolution))?;
    writeln!(writer, "origin: [{x}, {y}, {yaw}]")?;
    writeln!(writer, "negate: 0")?;
    writeln!(writer, "occupied_thresh: {OCCUPIED_THRESH}")?;
    writeln!(writer, "free_thresh: {FREE_THRESH}")
}

/// nav2's map saver: occupancy at or above the one threshold is black, at or below the other white, else grey.
fn grey(cell: i8) -> u8 {
    match cell {
        0..=100 if f64::from(cell) >= (100.0 * OCCUPIED_THRESH).round() => GREY_OCCUPIED,
        0..=100 if f64::from(cell) <= (100.0 * FREE_THRESH).round() => GREY_FREE,
        _ => GREY_UNKNOWN,
    }
}

fn check(grid: &OccupancyGrid) -> io::Result<()> {
    let cells = u64::from(grid.width) * u64::from(grid.height);
    let sound =
        grid.resolution.is_finite() && grid.resolution > 0.0 && grid.origin.iter().all(|o| o.is_finite());
    if sound && cells > 0 && cells == grid.cells.len() as u64 {
        return Ok(());
    }
    let cause = format!(
        "a grid of {} x {} with {} cells, resolution {} m and origin {:?} cannot be saved",
        grid.width,
        grid.height,
        grid.cells.len(),
        grid.resolution,
        grid.origin
    );
    Err(io::Error::new(io::ErrorKind::InvalidInput, cause))
}

/// The shortest decimal that brings the same number back, never with an exponent (YAML 1.1 readers take `1e-7` for text).
fn decimal(number: f64) -> String {
    let text = number.to_string();
    if text.contains('.') { text } else { text + ".0" }
}

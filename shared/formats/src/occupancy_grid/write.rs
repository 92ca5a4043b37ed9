//! Saves a flat map as nav2's map saver does in trinary mode.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use super::{FREE_THRESH, Mode, OCCUPIED_THRESH, OccupancyGrid};
use crate::{FormatError, write_atomically};

const GREY_OCCUPIED: u8 = 0;
const GREY_UNKNOWN: u8 = 205;
const GREY_FREE: u8 = 254;

/// Writes `yaml_path` in trinary mode, and a picture of the same name with the ending `.pgm`; see [`write_as`].
///
/// # Errors
/// As [`write_as`].
pub fn write(yaml_path: &Path, grid: &OccupancyGrid) -> Result<(), FormatError> {
    write_as(yaml_path, grid, Mode::Trinary, &[])
}

/// Writes `yaml_path`, with `comments` as its first lines, and a picture, each whole or not at all, and at no moment a picture that does not
/// belong to the map file. The picture
/// has the same name and the ending `.pgm`, in scale mode `_scale.png`.
///
/// Numbers are written with every digit they need (nav2's own saver cuts the origin to three significant digits).
///
/// # Errors
/// [`FormatError::Io`] naming the file; also where the grid's numbers do not fit together.
pub fn write_as(
    yaml_path: &Path,
    grid: &OccupancyGrid,
    mode: Mode,
    comments: &[&str],
) -> Result<(), FormatError> {
    let stem = yaml_path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = if mode == Mode::Scale { "_scale.png" } else { ".pgm" };
    let write_picture = |name: &str| {
        write_atomically(&yaml_path.with_file_name(name), |writer| match mode {
            Mode::Scale => write_png(writer, grid),
            Mode::Trinary => write_pgm(writer, grid, grey),
            Mode::Raw => {
                write_pgm(writer, grid, |cell| if (0..=100).contains(&cell) { cell as u8 } else { u8::MAX })
            }
        })
    };
    let write_keys = |name: &str| {
        write_atomically(yaml_path, |writer| writer.write_all(yaml(grid, mode, name, comments).as_bytes()))
    };
    let picture = format!("{stem}{ending}");
    let before = fs::read_to_string(yaml_path).unwrap_or_default();
    if before == yaml(grid, mode, &picture, comments) {
        return write_picture(&picture);
    }
    // A new picture with an old origin would be a wrong map. So the map file names another picture while this one changes,
    // whichever it does not name already: that is where somebody has pulled the plug the last time.
    let spares = [format!("{stem}.new{ending}"), format!("{stem}.newer{ending}")];
    let free = spares.iter().find(|name| !before.contains(name.as_str()));
    for name in free.into_iter().chain([&picture]) {
        write_picture(name)?;
        write_keys(name)?;
    }
    for path in spares.iter().map(|name| yaml_path.with_file_name(name)).filter(|path| path.exists()) {
        fs::remove_file(&path).map_err(|cause| FormatError::writing(&path, cause))?;
    }
    Ok(())
}

fn write_pgm(writer: &mut impl Write, grid: &OccupancyGrid, grey: impl Fn(i8) -> u8) -> io::Result<()> {
    check(grid)?;
    write!(
        writer,
        "P5\n# CREATOR: evac {:.3} m/pix\n{} {}\n255\n",
        grid.resolution, grid.width, grid.height
    )?;
    let mut line = Vec::with_capacity(grid.width as usize);
    for row in grid.cells.chunks_exact(grid.width as usize).rev() {
        line.clear();
        line.extend(row.iter().map(|cell| grey(*cell)));
        writer.write_all(&line)?;
    }
    Ok(())
}

/// As nav2's map saver in scale mode: white is free, black occupied, unknown a transparent grey.
fn write_png(writer: &mut impl Write, grid: &OccupancyGrid) -> io::Result<()> {
    check(grid)?;
    let pixel = |cell: &i8| match *cell {
        cell @ 0..=100 => [((100 - i32::from(cell)) * 255 / 100) as u8, u8::MAX],
        _ => [127, 0],
    };
    let data: Vec<u8> =
        grid.cells.chunks_exact(grid.width as usize).rev().flatten().flat_map(pixel).collect();
    let mut encoder = png::Encoder::new(writer, grid.width, grid.height);
    encoder.set_color(png::ColorType::GrayscaleAlpha);
    encoder.set_depth(png::BitDepth::Eight);
    let mut image = encoder.write_header().map_err(io::Error::other)?;
    image.write_image_data(&data).map_err(io::Error::other)?;
    image.finish().map_err(io::Error::other)
}

/// The map file's text.
fn yaml(grid: &OccupancyGrid, mode: Mode, picture: &str, comments: &[&str]) -> String {
    let [x, y, yaw] = grid.origin.map(decimal);
    let name = match mode {
        Mode::Trinary => "trinary",
        Mode::Scale => "scale",
        Mode::Raw => "raw",
    };
    // Between the thresholds of scale mode all greys are told apart.
    let (occupied, free) = if mode == Mode::Scale { (1.0, 0.0) } else { (OCCUPIED_THRESH, FREE_THRESH) };
    let (resolution, occupied, free) = (decimal(grid.resolution), decimal(occupied), decimal(free));
    let comments: String = comments.iter().map(|comment| format!("# {comment}\n")).collect();
    format!(
        "{comments}image: {picture}\nmode: {name}\nresolution: {resolution}\norigin: [{x}, {y}, {yaw}]\n\
        negate: 0\noccupied_thresh: {occupied}\nfree_thresh: {free}\n"
    )
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

//! Loads a flat map by the rules of nav2's map loader.

use std::fs;
use std::path::Path;

use super::image::{self, GreyImage};
use super::yaml::Keys;
use super::{FREE, Mode, OCCUPIED, OccupancyGrid, UNKNOWN};
use crate::FormatError;

/// The rules of one map file.
#[derive(Debug, Clone, Copy)]
struct Rules {
    mode: Mode,
    negate: bool,
    occupied_thresh: f64,
    free_thresh: f64,
}

/// Reads a map file and the picture it names (binary 8-bit PGM, or 8-bit grey PNG with or without transparency).
///
/// Defaults are nav2's: `mode: trinary`, `negate: 0`, `occupied_thresh: 0.65`, `free_thresh: 0.25`.
///
/// # Errors
/// [`FormatError`] naming the file at fault, the YAML or the picture.
pub fn read(yaml_path: &Path) -> Result<OccupancyGrid, FormatError> {
    let load = |path: &Path| fs::read(path).map_err(|cause| FormatError::reading(path, cause));
    let bytes = load(yaml_path)?;
    let keys = Keys::parse(&bytes, yaml_path)?;
    let resolution = keys.needed("resolution", keys.number("resolution")?)?;
    if resolution <= 0.0 {
        return Err(
            keys.fault("resolution", format!("\"resolution\" is {resolution} where metres are needed"))
        );
    }
    let origin = keys.needed("origin", keys.three("origin")?)?;
    let rules = rules(&keys)?;
    let name = keys.needed("image", keys.text("image")?)?;
    // An absolute name replaces the folder.
    let picture_path = yaml_path.with_file_name("").join(name);
    let picture = image::parse(&load(&picture_path)?, &picture_path)?;
    let cells = cells(&picture, rules);
    Ok(OccupancyGrid { width: picture.width, height: picture.height, resolution, origin, cells })
}

fn rules(keys: &Keys<'_>) -> Result<Rules, FormatError> {
    let mode = match keys.text("mode")? {
        None | Some("trinary") => Mode::Trinary,
        Some("scale") => Mode::Scale,
        Some("raw") => Mode::Raw,
        Some(other) => {
            return Err(keys.fault("mode", format!("mode {other:?} is none of trinary, scale, raw")));
        }
    };
    let negate = match keys.text("negate")? {
        None | Some("0" | "false") => false,
        Some("1" | "true") => true,
        Some(other) => {
            return Err(keys.fault("negate", format!("\"negate\" is {other:?} where 0 or 1 is needed")));
        }
    };
    let occupied_thresh = keys.number("occupied_thresh")?.unwrap_or(0.65);
    let free_thresh = keys.number("free_thresh")?.unwrap_or(0.25);
    if !(0.0 <= free_thresh && free_thresh < occupied_thresh && occupied_thresh <= 1.0) {
        let cause = format!(
            "free_thresh {free_thresh} and occupied_thresh {occupied_thresh} are not 0 <= free < occupied <= 1"
        );
        return Err(keys.fault("free_thresh", cause));
    }
    Ok(Rules { mode, negate, occupied_thresh, free_thresh })
}

/// The picture's rows from the bottom up.
fn cells(picture: &GreyImage, rules: Rules) -> Vec<i8> {
    let table: [i8; 256] = std::array::from_fn(|grey| cell(grey as f64 / f64::from(picture.maximum), rules));
    let rows = picture.pixels.chunks_exact(picture.width as usize).rev();
    let mut cells: Vec<i8> =
        rows.flatten().map(|grey| table.get(usize::from(*grey)).copied().unwrap_or(UNKNOWN)).collect();
    // Only in this mode nav2 and ROS 1 both look at the transparency.
    if rules.mode == Mode::Scale && !picture.alpha.is_empty() {
        let alpha = picture.alpha.chunks_exact(picture.width as usize).rev().flatten();
        for (cell, _) in cells.iter_mut().zip(alpha).filter(|(_, alpha)| **alpha < u8::MAX) {
            *cell = UNKNOWN;
        }
    }
    cells
}

fn cell(shade: f64, rules: Rules) -> i8 {
    let occupancy = if rules.negate { shade } else { 1.0 - shade };
    match rules.mode {
        Mode::Raw => {
            let value = (shade * 255.0).round();
            if value <= f64::from(OCCUPIED) { value as i8 } else { UNKNOWN }
        }
        _ if occupancy > rules.occupied_thresh => OCCUPIED,
        _ if occupancy < rules.free_thresh => FREE,
        Mode::Trinary => UNKNOWN,
        Mode::Scale => {
            let share = (occupancy - rules.free_thresh) / (rules.occupied_thresh - rules.free_thresh);
            (share * 100.0).round_ties_even() as i8
        }
    }
}

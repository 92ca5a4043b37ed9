//! The plan as a picture for people: walls dark, free space white, what is unknown hatched grey, the walked path with
//! its start and end, a metre grid, a scale bar and a legend.

mod furniture;
mod map;

use evac_formats::occupancy_grid::{FREE, OccupancyGrid};
use evac_formats::rgb_image::RgbImage;
use evac_picture::{Canvas, Colour, Frame, text_height, text_width};

use crate::path::Path;

use self::map::MapView;

const PAPER: Colour = [255, 255, 255];
const INK: Colour = [34, 34, 34];
const WALL: Colour = [24, 24, 28];
const UNSEEN: Colour = [222, 223, 226];
const HATCH: Colour = [201, 203, 208];
const METRE_LINE: Colour = [226, 233, 242];
const PATH_FIRST: Colour = [64, 160, 255];
const PATH_LAST: Colour = [10, 50, 150];
const START: Colour = [20, 150, 60];
const END: Colour = [205, 30, 40];

/// Narrowest picture, pixels.
const MIN_WIDTH: i64 = 900;
/// The map's longer side is drawn at least this long where that needs no more than [`MAX_SCALE`] pixels a cell.
const MAP_TARGET: u32 = 1100;
/// The map's longest side, so that the picture stays under 4000 pixels.
const MAP_LIMIT: u32 = 3300;
/// Most pixels a cell.
const MAX_SCALE: u32 = 24;

/// Draws the plan; `band_m` is named in the subtitle.
pub(crate) fn draw(grid: &OccupancyGrid, path: &Path, band_m: [f64; 2]) -> RgbImage {
    let longest = grid.width.max(grid.height).max(1);
    // Pixels a cell, or cells a pixel where the grid is larger than the picture may be.
    let scale = MAP_TARGET.div_ceil(longest).min(MAX_SCALE);
    let reduction = longest.div_ceil(MAP_LIMIT);
    let [map_width, map_height] =
        [grid.width, grid.height].map(|cells| i64::from(cells.div_ceil(reduction) * scale));

    // The dots of the texts grow with the picture.
    let dot = if map_width.max(map_height) > 2000 { 4 } else { 2 };
    let pad = 10 * dot;
    let line = 12 * dot;
    let gutter = text_width("-1000", dot) + 3 * dot;
    let width = (map_width + gutter + 2 * pad).max(MIN_WIDTH);
    let texts = subtitle(grid, path, band_m, dot, width - 2 * pad);
    let left = pad + gutter + (width - 2 * pad - gutter - map_width) / 2;
    let top = pad + text_height(2 * dot) + line * (texts.len() as i64) + 2 * line;
    let frame = Frame { left, top, right: left + map_width, bottom: top + map_height };
    let below = frame.bottom + 2 * line;
    let legend = furniture::legend_rows(dot, width - 2 * pad);
    let height = below + 3 * line + legend.len() as i64 * 2 * line + pad;

    let mut canvas = Canvas::new(width as u32, height as u32, PAPER);
    canvas.text(pad, pad, 2 * dot, INK, "Evacuation map");
    for (text, row) in texts.iter().zip(0..) {
        canvas.text(pad, pad + text_height(2 * dot) + line + row * line, dot, INK, text);
    }
    let view = MapView { grid, frame, scale, reduction, dot };
    view.draw(&mut canvas, path);
    furniture::scale_bar(&mut canvas, &view, pad, below + dot);
    furniture::axes(&mut canvas, width - pad, below + 3 * line, dot);
    furniture::legend(&mut canvas, &legend, pad, below + 3 * line, dot);
    canvas.into_image()
}

/// Size, resolution and content in words, in as many lines as the width needs.
fn subtitle(grid: &OccupancyGrid, path: &Path, [low, high]: [f64; 2], dot: i64, width: i64) -> Vec<String> {
    let resolution = grid.resolution;
    let free = grid.cells.iter().filter(|cell| **cell == FREE).count() as f64 * resolution * resolution;
    let parts = [
        format!("{:.1} x {:.1} m", f64::from(grid.width) * resolution, f64::from(grid.height) * resolution),
        format!("cells of {resolution:.2} m"),
        format!("{free:.0} m² free"),
        format!("{:.0} m walked", path.length()),
        format!("obstacles {low:.1} - {high:.1} m above ground"),
    ];
    let mut lines: Vec<String> = Vec::new();
    for part in parts {
        match lines.last_mut() {
            Some(line) if text_width(&format!("{line}, {part}"), dot) <= width => {
                *line = format!("{line}, {part}")
            }
            _ => lines.push(part),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use evac_formats::occupancy_grid::{OCCUPIED, UNKNOWN};

    use super::*;

    fn grid(width: u32, height: u32, cell: i8) -> OccupancyGrid {
        let cells = vec![cell; width as usize * height as usize];
        OccupancyGrid { width, height, resolution: 0.1, origin: [-1.0, -1.0, 0.0], cells }
    }

    #[test]
    fn pictures_of_any_map_are_between_900_and_4000_pixels() {
        for (width, height) in
            [(1, 1), (30, 700), (700, 30), (1200, 1200), (3500, 3500), (4000, 100), (8192, 50)]
        {
            let image = draw(&grid(width, height, FREE), &Path::new(), [0.2, 1.8]);
            assert!((900..=4000).contains(&image.width()), "{width} x {height}: {} wide", image.width());
            assert!(image.height() <= 4000, "{width} x {height}: {} high", image.height());
        }
    }

    #[test]
    fn a_wall_one_cell_thick_stays_visible_on_a_map_larger_than_the_picture() {
        let mut large = grid(8000, 40, FREE);
        large.cells[20 * 8000 + 4001] = OCCUPIED;
        let image = draw(&large, &Path::new(), [0.2, 1.8]);
        let dark = pixels(&image).filter(|colour| *colour == WALL).count();
        let without = draw(&grid(8000, 40, FREE), &Path::new(), [0.2, 1.8]);
        assert_eq!(dark, pixels(&without).filter(|colour| *colour == WALL).count() + 1);
    }

    #[test]
    fn the_path_runs_from_a_green_start_to_a_red_end_over_the_map() {
        let mut path = Path::new();
        (0..=40).for_each(|i| assert!(path.push([f64::from(i) * 0.1, 0.0, 0.0])));
        let image = draw(&grid(60, 20, UNKNOWN), &path, [0.2, 1.8]);
        let without = draw(&grid(60, 20, UNKNOWN), &Path::new(), [0.2, 1.8]);
        for colour in [START, END] {
            let count = |image: &RgbImage| pixels(image).filter(|other| *other == colour).count();
            assert!(count(&image) > count(&without), "beside the one in the legend");
        }
        let first = |colour| (0..i64::from(image.width())).find(|x| column(&image, *x, colour));
        assert!(first(START).unwrap() < first(END).unwrap());
    }

    fn pixels(image: &RgbImage) -> impl Iterator<Item = Colour> {
        let (width, height) = (i64::from(image.width()), i64::from(image.height()));
        (0..height).flat_map(move |y| (0..width).filter_map(move |x| image.get(x, y)))
    }

    /// Whether the upper three quarters of a column, the map, hold a colour.
    fn column(image: &RgbImage, x: i64, colour: Colour) -> bool {
        (0..i64::from(image.height()) * 3 / 4).any(|y| image.get(x, y) == Some(colour))
    }
}

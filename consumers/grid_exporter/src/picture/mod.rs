//! The plan as a picture for people: walls dark, free space white, what is unknown hatched grey, the walked path with
//! its start and end, a metre grid, a scale bar and a legend.

mod furniture;
mod ground;
mod layout;
mod map;

use evac_formats::occupancy_grid::{FREE, OccupancyGrid};
use evac_formats::rgb_image::RgbImage;
use evac_picture::Colour;

use crate::path::Route;

pub(crate) use self::ground::ground;
use self::layout::Layout;

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

/// Draws the plan; `band_m` and `storey` (if not empty) are named in the subtitle.
pub(crate) fn plan(grid: &OccupancyGrid, route: &Route, band_m: [f64; 2], storey: &str) -> RgbImage {
    let parts = subtitle(grid, route, band_m, storey);
    let (dot, width) = Layout::text_width(grid);
    let legend = furniture::legend_rows(dot, width);
    let layout = Layout::new(grid, &parts, legend.len() as i64);
    let (mut canvas, view) = layout.start("Evacuation map", &parts);
    view.draw(&mut canvas, route);
    furniture::scale_bar(&mut canvas, &view, layout.pad, layout.below + dot);
    furniture::axes(&mut canvas, layout.width - layout.pad, layout.below + 3 * layout.line, dot);
    furniture::legend(&mut canvas, &legend, layout.pad, layout.below + 3 * layout.line, dot);
    canvas.into_image()
}

/// Size, resolution and content in words.
fn subtitle(grid: &OccupancyGrid, route: &Route, [low, high]: [f64; 2], storey: &str) -> [String; 6] {
    let resolution = grid.resolution;
    let free = grid.cells.iter().filter(|cell| **cell == FREE).count() as f64 * resolution * resolution;
    [
        storey.to_owned(),
        format!("{:.1} x {:.1} m", f64::from(grid.width) * resolution, f64::from(grid.height) * resolution),
        format!("cells of {resolution:.2} m"),
        format!("{free:.0} m² free"),
        format!("{:.0} m walked", route.length),
        format!("obstacles {low:.1} - {high:.1} m above ground"),
    ]
}

#[cfg(test)]
mod tests {
    use evac_formats::occupancy_grid::{OCCUPIED, UNKNOWN};

    use super::*;
    use crate::path::Path;

    fn grid(width: u32, height: u32, cell: i8) -> OccupancyGrid {
        let cells = vec![cell; width as usize * height as usize];
        OccupancyGrid { width, height, resolution: 0.1, origin: [-1.0, -1.0, 0.0], cells }
    }

    #[test]
    fn pictures_of_any_map_are_between_900_and_4000_pixels() {
        for (width, height) in
            [(1, 1), (30, 700), (700, 30), (1200, 1200), (3500, 3500), (4000, 100), (8192, 50)]
        {
            let image = plan(&grid(width, height, FREE), &Route::default(), [0.2, 1.8], "");
            assert!((900..=4000).contains(&image.width()), "{width} x {height}: {} wide", image.width());
            assert!(image.height() <= 4000, "{width} x {height}: {} high", image.height());
        }
    }

    #[test]
    fn a_wall_one_cell_thick_stays_visible_on_a_map_larger_than_the_picture() {
        let mut large = grid(8000, 40, FREE);
        large.cells[20 * 8000 + 4001] = OCCUPIED;
        let image = plan(&large, &Route::default(), [0.2, 1.8], "");
        let dark = pixels(&image).filter(|colour| *colour == WALL).count();
        let without = plan(&grid(8000, 40, FREE), &Route::default(), [0.2, 1.8], "");
        assert_eq!(dark, pixels(&without).filter(|colour| *colour == WALL).count() + 1);
    }

    #[test]
    fn the_path_runs_from_a_green_start_to_a_red_end_over_the_map() {
        let mut path = Path::new();
        (0..=40).for_each(|i| assert!(path.push([f64::from(i) * 0.1, 0.0, 0.0])));
        let image = plan(&grid(60, 20, UNKNOWN), &path.route(|_| true), [0.2, 1.8], "");
        let without = plan(&grid(60, 20, UNKNOWN), &Route::default(), [0.2, 1.8], "");
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

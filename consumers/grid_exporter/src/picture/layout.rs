//! Where things are on a picture.

use evac_formats::occupancy_grid::OccupancyGrid;
use evac_picture::{Canvas, Frame, text_height, text_width};

use super::map::MapView;
use super::{INK, PAPER};

/// Narrowest picture, pixels.
const MIN_WIDTH: i64 = 900;
/// The map's longer side is drawn at least this long where that needs no more than [`MAX_SCALE`] pixels a cell.
const MAP_TARGET: u32 = 1100;
/// The map's longest side, so that the picture stays under 4000 pixels.
const MAP_LIMIT: u32 = 3300;
/// Most pixels a cell.
const MAX_SCALE: u32 = 24;

/// Title and subtitle, the map, and room for what stands below it, all in pixels.
pub(super) struct Layout<'a> {
    grid: &'a OccupancyGrid,
    scale: u32,
    reduction: u32,
    frame: Frame,
    height: i64,
    /// Pixels a dot of the font.
    pub(super) dot: i64,
    pub(super) pad: i64,
    pub(super) line: i64,
    pub(super) width: i64,
    /// Upper end of what stands below the map.
    pub(super) below: i64,
}

impl<'a> Layout<'a> {
    /// `parts` of the subtitle; `rows` of the legend.
    pub(super) fn new(grid: &'a OccupancyGrid, parts: &[String], rows: i64) -> Self {
        let longest = grid.width.max(grid.height).max(1);
        // Pixels a cell, or cells a pixel where the grid is larger than the picture may be.
        let scale = MAP_TARGET.div_ceil(longest).min(MAX_SCALE);
        let reduction = longest.div_ceil(MAP_LIMIT);
        let [map_width, map_height] =
            [grid.width, grid.height].map(|cells| i64::from(cells.div_ceil(reduction) * scale));
        // The dots of the texts grow with the picture.
        let dot = if map_width.max(map_height) > 2000 { 4 } else { 2 };
        let (pad, line) = (10 * dot, 12 * dot);
        let gutter = text_width("-1000", dot) + 3 * dot;
        let width = (map_width + gutter + 2 * pad).max(MIN_WIDTH);
        let texts = lines(parts, dot, width - 2 * pad).len() as i64;
        let left = pad + gutter + (width - 2 * pad - gutter - map_width) / 2;
        let top = pad + text_height(2 * dot) + line * texts + 2 * line;
        let frame = Frame { left, top, right: left + map_width, bottom: top + map_height };
        let below = frame.bottom + 2 * line;
        let height = below + 3 * line + rows * 2 * line + pad;
        Self { grid, scale, reduction, frame, height, dot, pad, line, width, below }
    }

    /// Width that legends and texts may take.
    pub(super) fn text_width(grid: &OccupancyGrid) -> (i64, i64) {
        let layout = Layout::new(grid, &[], 0);
        (layout.dot, layout.width - 2 * layout.pad)
    }

    /// A canvas with title and subtitle, and the map's place on it.
    pub(super) fn start(&self, title: &str, parts: &[String]) -> (Canvas, MapView<'a>) {
        let Self { dot, pad, line, .. } = *self;
        let mut canvas = Canvas::new(self.width as u32, self.height as u32, PAPER);
        canvas.text(pad, pad, 2 * dot, INK, title);
        for (text, row) in lines(parts, dot, self.width - 2 * pad).iter().zip(0..) {
            canvas.text(pad, pad + text_height(2 * dot) + line + row * line, dot, INK, text);
        }
        let view =
            MapView { grid: self.grid, frame: self.frame, scale: self.scale, reduction: self.reduction, dot };
        (canvas, view)
    }
}

/// The parts that are not empty, in as many lines as the width needs.
fn lines(parts: &[String], dot: i64, width: i64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for part in parts.iter().filter(|part| !part.is_empty()) {
        match lines.last_mut() {
            Some(line) if text_width(&format!("{line}, {part}"), dot) <= width => {
                *line = format!("{line}, {part}");
            }
            _ => lines.push(part.clone()),
        }
    }
    lines
}

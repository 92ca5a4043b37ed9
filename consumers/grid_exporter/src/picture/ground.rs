//! The second layer as a picture: height of the ground in colours, steps marked, obstacles dark.

use evac_formats::occupancy_grid::{OCCUPIED, OccupancyGrid, UNKNOWN};
use evac_formats::rgb_image::RgbImage;
use evac_picture::{Canvas, Colour, Frame, text_height, text_width};

use super::layout::Layout;
use super::map;
use super::{INK, PAPER, WALL, furniture};
use crate::relief::Relief;

/// From the lowest ground to the highest; even in brightness, and told apart by those who see no red or green.
const HEIGHTS: [Colour; 5] = [[59, 76, 160], [66, 136, 181], [92, 185, 154], [173, 217, 110], [250, 231, 90]];
/// Smallest span of heights that gets all colours, metres: voxels of an even floor stay of one colour.
const LEAST_SPAN_M: f32 = 0.5;
/// Steps from which on people stumble and wheels stop, metres, with their colours.
const STEPS: [(f32, Colour, &str); 2] =
    [(0.12, [238, 140, 40], "step over 0.12 m"), (0.25, [205, 30, 40], "step over 0.25 m")];

/// Draws height and steps of the ground; `storey` (if not empty) is named in the subtitle.
pub(crate) fn ground(grid: &OccupancyGrid, relief: &Relief, storey: &str) -> RgbImage {
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for height in relief.ground.iter().filter(|height| height.is_finite()) {
        (low, high) = (low.min(*height), high.max(*height));
    }
    if low > high {
        (low, high) = (0.0, 0.0);
    }
    let spare = (LEAST_SPAN_M - (high - low)).max(0.0) / 2.0;
    let span = [low - spare, high + spare];
    let parts = [
        storey.to_owned(),
        format!("ground from {low:.2} to {high:.2} m in the map frame"),
        format!("cells of {:.2} m", grid.resolution),
    ];
    let layout = Layout::new(grid, &parts, 1);
    let (mut canvas, view) = layout.start("Ground and steps", &parts);
    let Frame { left, top, right, bottom } = view.frame;
    for (x, y) in (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y))) {
        let (cx, cy) = view.cell_at((x - left) as u32, (bottom - 1 - y) as u32);
        let place = cy as usize * grid.width as usize + cx as usize;
        let height = relief.ground.get(place).copied().unwrap_or(f32::NAN);
        let step = relief.step.get(place).copied().unwrap_or(f32::NAN);
        let cell = grid.cells.get(place).copied().unwrap_or(UNKNOWN);
        let colour = match STEPS.iter().rev().find(|(from, _, _)| step >= *from) {
            _ if cell == OCCUPIED => WALL,
            Some((_, colour, _)) => *colour,
            None if height.is_finite() => shade(height, span),
            None => map::colour(cell, x, y, layout.dot),
        };
        canvas.pixel(x, y, colour);
    }
    view.draw_border(&mut canvas);
    furniture::scale_bar(&mut canvas, &view, layout.pad, layout.below + layout.dot);
    furniture::axes(&mut canvas, layout.width - layout.pad, layout.below + 3 * layout.line, layout.dot);
    legend(&mut canvas, &layout, span);
    canvas.into_image()
}

fn legend(canvas: &mut Canvas, layout: &Layout<'_>, span: [f32; 2]) {
    let dot = layout.dot;
    let top = layout.below + 3 * layout.line;
    let (bottom, text_top) = (top + 14 * dot, top + 7 * dot - text_height(dot) / 2);
    let low = format!("{:.1} m", span[0]);
    canvas.text(layout.pad, text_top, dot, INK, &low);
    let left = layout.pad + text_width(&low, dot) + 6 * dot;
    let bar = Frame { left, top, right: left + 90 * dot, bottom };
    for x in bar.left..bar.right {
        let share = (x - bar.left) as f32 / bar.width() as f32;
        let colour = shade(span[0] + (span[1] - span[0]) * share, span);
        canvas.fill(Frame { left: x, right: x + 1, ..bar }, colour);
    }
    canvas.outline(bar, (dot / 2).max(1), INK);
    let high = format!("{:.1} m", span[1]);
    canvas.text(bar.right + 6 * dot, text_top, dot, INK, &high);
    let mut left = bar.right + 22 * dot + text_width(&high, dot);
    for (colour, text) in STEPS.iter().map(|(_, colour, text)| (*colour, *text)).chain([(WALL, "obstacle")]) {
        let sign = Frame { left, top, right: left + 24 * dot, bottom };
        canvas.fill(sign, colour);
        canvas.outline(sign, (dot / 2).max(1), INK);
        canvas.text(sign.right + 6 * dot, text_top, dot, INK, text);
        left = sign.right + 22 * dot + text_width(text, dot);
    }
}

fn shade(height: f32, [low, high]: [f32; 2]) -> Colour {
    let at = ((height - low) / (high - low)).clamp(0.0, 1.0) * (HEIGHTS.len() - 1) as f32;
    let first = (at as usize).min(HEIGHTS.len() - 2);
    match HEIGHTS.get(first..first + 2) {
        Some([a, b]) => map::blend(*a, *b, f64::from(at) - first as f64),
        _ => PAPER,
    }
}

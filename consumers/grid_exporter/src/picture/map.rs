//! The map itself: cells, metre grid, path and markers.

use evac_formats::occupancy_grid::{FREE, OCCUPIED, OccupancyGrid, UNKNOWN};
use evac_picture::{Canvas, Colour, Frame, text_height, text_width};

use crate::path::Route;

use super::{END, HATCH, INK, METRE_LINE, PAPER, PATH_FIRST, PATH_LAST, START, UNSEEN, WALL};

/// A grid in its place on the picture.
pub(super) struct MapView<'a> {
    pub(super) grid: &'a OccupancyGrid,
    pub(super) frame: Frame,
    /// Pixels a cell.
    pub(super) scale: u32,
    /// Cells a pixel; one of the two is 1.
    pub(super) reduction: u32,
    /// Pixels a dot of the font; strokes follow it.
    pub(super) dot: i64,
}

impl MapView<'_> {
    pub(super) fn draw(&self, canvas: &mut Canvas, route: &Route) {
        self.draw_cells(canvas);
        self.draw_border(canvas);
        canvas.clip(self.frame);
        self.draw_path(canvas, route);
        canvas.unclip();
    }

    /// The metre grid, its numbers, and the frame.
    pub(super) fn draw_border(&self, canvas: &mut Canvas) {
        self.draw_metre_grid(canvas);
        canvas.outline(self.frame, self.dot / 2, INK);
    }

    /// The cell at a pixel counted from the lower left corner; of several the first.
    pub(super) fn cell_at(&self, x: u32, y: u32) -> (u32, u32) {
        (x / self.scale * self.reduction, y / self.scale * self.reduction)
    }

    /// Pixels of one metre.
    pub(super) fn metre(&self) -> f64 {
        f64::from(self.scale) / (f64::from(self.reduction) * self.grid.resolution)
    }

    /// A length of 1, 2 or 5 times a power of ten metres that is at least `pixels` long.
    pub(super) fn round_length(&self, pixels: f64) -> f64 {
        let wanted = pixels / self.metre();
        let decade = 10f64.powf(wanted.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].into_iter().find(|step| step * decade >= wanted);
        step.unwrap_or(10.0) * decade
    }

    fn draw_cells(&self, canvas: &mut Canvas) {
        let Frame { left, top, right, bottom } = self.frame;
        for (x, y) in (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y))) {
            let cell = self.cell((x - left) as u32, (bottom - 1 - y) as u32);
            canvas.pixel(x, y, colour(cell, x, y, self.dot));
        }
    }

    /// What is shown at a pixel counted from the lower left corner; of several cells an obstacle
    /// where there is one, else what most of them are.
    fn cell(&self, x: u32, y: u32) -> i8 {
        let (x, y) = self.cell_at(x, y);
        let rows = y..(y + self.reduction).min(self.grid.height);
        let columns = x..(x + self.reduction).min(self.grid.width);
        let at = |x: u32, y: u32| self.grid.cells.get(y as usize * self.grid.width as usize + x as usize);
        let (mut free, mut unseen) = (0, 0);
        for cell in rows.flat_map(|y| columns.clone().map(move |x| (x, y))).filter_map(|(x, y)| at(x, y)) {
            match *cell {
                OCCUPIED => return OCCUPIED,
                FREE => free += 1,
                _ => unseen += 1,
            }
        }
        if free > unseen { FREE } else { UNKNOWN }
    }

    /// Lines at round coordinates of the map frame, with their metres at the border.
    fn draw_metre_grid(&self, canvas: &mut Canvas) {
        let step = self.round_length(40.0 * self.dot as f64);
        let Frame { left, top, right, bottom } = self.frame;
        let [x0, y0, _] = self.grid.origin;
        let decimals = usize::from(step < 1.0);
        let dot = self.dot;
        for line in multiples(x0, self.frame.width() as f64 / self.metre(), step) {
            let x = left + ((line - x0) * self.metre()).round() as i64;
            self.metre_line(canvas, Frame { left: x, top, right: x + 1, bottom });
            canvas.fill(Frame { left: x, top: bottom, right: x + 1, bottom: bottom + 3 * dot }, INK);
            let text = format!("{line:.decimals$}");
            canvas.text(x - text_width(&text, dot) / 2, bottom + 5 * dot, dot, INK, &text);
        }
        for line in multiples(y0, self.frame.height() as f64 / self.metre(), step) {
            let y = bottom - 1 - ((line - y0) * self.metre()).round() as i64;
            self.metre_line(canvas, Frame { left, top: y, right, bottom: y + 1 });
            canvas.fill(Frame { left: left - 3 * dot, top: y, right: left, bottom: y + 1 }, INK);
            let text = format!("{line:.decimals$}");
            canvas.text(left - 5 * dot - text_width(&text, dot), y - text_height(dot) / 2, dot, INK, &text);
        }
    }

    /// Over free cells only: elsewhere the hatching tells enough.
    fn metre_line(&self, canvas: &mut Canvas, line: Frame) {
        let Frame { left, bottom, .. } = self.frame;
        for (x, y) in (line.top..line.bottom).flat_map(|y| (line.left..line.right).map(move |x| (x, y))) {
            if self.frame.contains(x, y) && self.cell((x - left) as u32, (bottom - 1 - y) as u32) == FREE {
                canvas.pixel(x, y, METRE_LINE);
            }
        }
    }

    fn draw_path(&self, canvas: &mut Canvas, route: &Route) {
        let width = 1.6 * self.dot as f64;
        let legs: Vec<Vec<[f64; 2]>> =
            route.legs.iter().map(|leg| leg.iter().map(|[x, y]| self.pixel(*x, *y)).collect()).collect();
        let pairs = || legs.iter().flat_map(|leg| leg.iter().zip(leg.iter().skip(1)));
        for (a, b) in pairs() {
            canvas.line(*a, *b, 2.0 * width, PAPER);
        }
        let lengths: Vec<f64> = pairs().map(|(a, b)| (b[0] - a[0]).hypot(b[1] - a[1])).collect();
        let total: f64 = lengths.iter().sum();
        let (mut done, mut next_arrow) = (0.0, 35.0 * self.dot as f64);
        for ((a, b), length) in pairs().zip(&lengths) {
            let colour = blend(PATH_FIRST, PATH_LAST, done / total.max(1.0));
            canvas.line(*a, *b, width, colour);
            done += length;
            if done >= next_arrow {
                let along = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
                canvas.arrow_head(*b, along, 5.0 * self.dot as f64, colour);
                next_arrow = done + 60.0 * self.dot as f64;
            }
        }
        let [start, end] = route.has_ends;
        if let Some(place) = legs.first().and_then(|leg| leg.first()).filter(|_| start) {
            start_marker(canvas, *place, self.dot);
        }
        if let Some(place) = legs.last().and_then(|leg| leg.last()).filter(|_| end) {
            end_marker(canvas, *place, self.dot);
        }
    }

    fn pixel(&self, x: f64, y: f64) -> [f64; 2] {
        let [x0, y0, _] = self.grid.origin;
        [self.frame.left as f64 + (x - x0) * self.metre(), self.frame.bottom as f64 - (y - y0) * self.metre()]
    }
}

/// A large disc, so that an end at the same place leaves its rim visible.
pub(super) fn start_marker(canvas: &mut Canvas, at: [f64; 2], dot: i64) {
    let dot = dot as f64;
    canvas.disc(at, 8.5 * dot, PAPER);
    canvas.disc(at, 7.5 * dot, START);
}

/// A square.
pub(super) fn end_marker(canvas: &mut Canvas, [x, y]: [f64; 2], dot: i64) {
    let square = |half: i64| {
        let (x, y) = (x.floor() as i64, y.floor() as i64);
        Frame { left: x - half, top: y - half, right: x + half, bottom: y + half }
    };
    canvas.fill(square(5 * dot), PAPER);
    canvas.fill(square(4 * dot), END);
}

/// Colour of a cell at a pixel.
pub(super) fn colour(cell: i8, x: i64, y: i64, dot: i64) -> Colour {
    match cell {
        OCCUPIED => WALL,
        FREE => PAPER,
        _ if (x + y).rem_euclid(6 * dot) < dot => HATCH,
        _ => UNSEEN,
    }
}

/// Multiples of `step` within `length` from `start`.
fn multiples(start: f64, length: f64, step: f64) -> impl Iterator<Item = f64> {
    let first = (start / step).ceil();
    let last = ((start + length) / step).floor();
    // Adding 0 turns -0 into 0.
    (0..=(last - first).max(-1.0) as i64)
        .filter(move |_| last >= first)
        .map(move |i| (first + i as f64) * step + 0.0)
}

pub(super) fn blend(a: Colour, b: Colour, share: f64) -> Colour {
    let mut colour = a;
    for (value, (a, b)) in colour.iter_mut().zip(a.iter().zip(b)) {
        *value = (f64::from(*a) + (f64::from(b) - f64::from(*a)) * share).round() as u8;
    }
    colour
}

//! Frame, grid and numbers around a view.

use crate::Colour;
use crate::area::{Area, View};
use crate::lettering::{self, Align};
use crate::sheet::Sheet;
use crate::ticks::ticks;

pub(crate) const INK: Colour = [38, 38, 42];
const GRID: Colour = [228, 230, 234];

/// Pixels a dot of the font: numbers, labels, titles.
pub(crate) const NUMBER: f64 = 1.6;
pub(crate) const LABEL: f64 = 1.8;
pub(crate) const TITLE: f64 = 2.4;

/// Pixels between two ticks at least.
const X_SPACING: f64 = 90.0;
const Y_SPACING: f64 = 42.0;
const TICK: f64 = 5.0;

/// An axis: where its ticks are and how they are written.
#[derive(Debug, Clone)]
pub(crate) struct Axes {
    x: Vec<(f64, String)>,
    y: Vec<(f64, String)>,
}

impl Axes {
    /// Ticks for a view.
    pub(crate) fn of(view: &View) -> Self {
        let wanted = |pixels: f64, spacing: f64| (pixels / spacing).max(2.0);
        Self {
            x: ticks(view.x, wanted(view.area.width(), X_SPACING)),
            y: ticks(view.y, wanted(view.area.height(), Y_SPACING)),
        }
    }

    /// Ticks for a view in which a unit is as long in x as in y: of one step.
    pub(crate) fn equal(view: &View) -> Self {
        let wanted = |pixels: f64| pixels / X_SPACING;
        Self { x: ticks(view.x, wanted(view.area.width())), y: ticks(view.y, wanted(view.area.height())) }
    }

    /// Pixels that the y axis's numbers take to the left of the view.
    pub(crate) fn y_gutter(&self) -> f64 {
        let widest = self.y.iter().map(|(_, label)| lettering::width(label)).fold(0.0, f64::max);
        widest * NUMBER + TICK + 6.0
    }

    /// The grid, below everything else.
    pub(crate) fn grid(&self, sheet: &mut Sheet, view: &View) {
        let area = view.area;
        for (x, _) in &self.x {
            let [x, _] = view.place([*x, view.y[0]]);
            sheet.fill(Area { left: x - 0.5, right: x + 0.5, ..area }, GRID);
        }
        for (y, _) in &self.y {
            let [_, y] = view.place([view.x[0], *y]);
            sheet.fill(Area { top: y - 0.5, bottom: y + 0.5, ..area }, GRID);
        }
    }

    /// The frame with ticks and, for the lowest of several panels, numbers along x.
    pub(crate) fn frame(&self, sheet: &mut Sheet, view: &View, x_numbers: bool) {
        let area = view.area;
        sheet.outline(area, 1.0, INK);
        for (x, label) in &self.x {
            let [x, _] = view.place([*x, view.y[0]]);
            let tick = Area { left: x - 0.5, right: x + 0.5, top: area.bottom, bottom: area.bottom + TICK };
            sheet.fill(tick, INK);
            if x_numbers {
                sheet.text([x, area.bottom + TICK + 11.0], Align::Centre, NUMBER, INK, label);
            }
        }
        for (y, label) in &self.y {
            let [_, y] = view.place([view.x[0], *y]);
            sheet.fill(Area { left: area.left - TICK, right: area.left, top: y - 0.5, bottom: y + 0.5 }, INK);
            sheet.text([area.left - TICK - 4.0, y], Align::Right, NUMBER, INK, label);
        }
    }
}

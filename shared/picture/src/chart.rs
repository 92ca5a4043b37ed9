//! Line charts: panels one below the other over one x axis.

use std::path::Path;

use evac_formats::FormatError;
use evac_formats::rgb_image::RgbImage;

use crate::area::{Area, View, range};
use crate::axes::{Axes, INK, LABEL, TITLE};
use crate::legend::{Legend, Sign};
use crate::lettering::Align;
use crate::sheet::Sheet;
use crate::{Colour, Stroke};

/// Width of every chart, pixels.
pub(crate) const WIDTH: u32 = 1200;
pub(crate) const PAD: f64 = 18.0;
/// Height of a panel alone, of one of two, and of one of more.
const PANEL_HEIGHTS: [f64; 3] = [520.0, 320.0, 240.0];
const BETWEEN: f64 = 22.0;

/// A chart.
#[derive(Debug, Clone, PartialEq)]
pub struct LineChart {
    /// What it shows; may be empty.
    pub title: String,
    /// What x is, with its unit: `time (s)`.
    pub x_label: String,
    /// From above.
    pub panels: Vec<Panel>,
}

/// One frame of a chart with its own y axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Panel {
    /// What y is, with its unit: `memory (MiB)`.
    pub y_label: String,
    /// Values at the lower and upper border; none to fit the series.
    pub y_range: Option<[f64; 2]>,
    /// A fitted range is at least so wide: noise that means nothing is not blown up.
    pub min_span: f64,
    /// Bands are drawn below lines, the last on top.
    pub series: Vec<Series>,
}

/// One line or band.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend, which lists each name once; empty for none.
    pub name: String,
    /// How it looks; a band takes a light tone of the colour.
    pub stroke: Stroke,
    /// Its points.
    pub shape: Shape,
}

/// Points of a series, in the order of x. One that is not finite interrupts it.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A line through `[x, y]`.
    Line(Vec<[f64; 2]>),
    /// Everything between `[x, low, high]`.
    Band(Vec<[f64; 3]>),
}

/// Draws a chart into a PNG file, which appears whole or not at all.
///
/// # Errors
/// [`FormatError::Io`] naming `path`.
pub fn line_chart(path: &Path, chart: &LineChart) -> Result<(), FormatError> {
    chart.draw().write_png(path)
}

impl Series {
    /// A line.
    pub fn line(name: impl Into<String>, stroke: Stroke, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), stroke, shape: Shape::Line(points) }
    }

    /// A band between `low` and `high` of `[x, low, high]`.
    pub fn band(name: impl Into<String>, stroke: Stroke, points: Vec<[f64; 3]>) -> Self {
        Self { name: name.into(), stroke, shape: Shape::Band(points) }
    }

    fn x(&self) -> Box<dyn Iterator<Item = f64> + '_> {
        match &self.shape {
            Shape::Line(points) => Box::new(points.iter().map(|[x, _]| *x)),
            Shape::Band(points) => Box::new(points.iter().map(|[x, ..]| *x)),
        }
    }

    fn y(&self) -> Box<dyn Iterator<Item = f64> + '_> {
        match &self.shape {
            Shape::Line(points) => Box::new(points.iter().map(|[_, y]| *y)),
            Shape::Band(points) => Box::new(points.iter().flat_map(|[_, low, high]| [*low, *high])),
        }
    }

    fn sign(&self) -> Sign {
        match self.shape {
            Shape::Line(_) => Sign::Line(self.stroke),
            Shape::Band(_) => Sign::Band(light(self.stroke.colour)),
        }
    }
}

impl LineChart {
    /// The picture, 1200 pixels wide.
    pub fn draw(&self) -> RgbImage {
        let height = match self.panels.len() {
            0 | 1 => PANEL_HEIGHTS[0],
            2 => PANEL_HEIGHTS[1],
            _ => PANEL_HEIGHTS[2],
        };
        let legend = self.legend();
        let top = PAD + title_height(&self.title) + legend.height() + 8.0;
        let views = self.views(top, height);
        let bottom = views.last().map_or(top, |view| view.area.bottom);
        let mut sheet = Sheet::new(WIDTH, (bottom + 64.0).ceil() as u32);
        draw_title(&mut sheet, &self.title);
        legend.draw(&mut sheet, PAD, PAD + title_height(&self.title));
        for ((panel, view), number) in self.panels.iter().zip(&views).zip(1..) {
            panel.draw(&mut sheet, view, number == self.panels.len());
        }
        let middle = views.first().map_or(0.0, |view| f64::midpoint(view.area.left, view.area.right));
        sheet.text([middle, bottom + 44.0], Align::Centre, LABEL, INK, &self.x_label);
        sheet.finish()
    }

    fn legend(&self) -> Legend {
        let mut entries: Vec<(Sign, String)> = Vec::new();
        for series in self.panels.iter().flat_map(|panel| &panel.series).filter(|s| !s.name.is_empty()) {
            if !entries.iter().any(|(_, name)| *name == series.name) {
                entries.push((series.sign(), series.name.clone()));
            }
        }
        Legend::new(entries, f64::from(WIDTH) - 2.0 * PAD)
    }

    /// Where each panel's data are shown, all with the same left border.
    fn views(&self, top: f64, height: f64) -> Vec<View> {
        let x = range(self.panels.iter().flat_map(|panel| &panel.series).flat_map(Series::x), 0.0, 0.0);
        let mut views: Vec<_> = (0..)
            .zip(&self.panels)
            .map(|(number, panel)| {
                let top = top + f64::from(number) * (height + BETWEEN);
                let area = Area { left: 0.0, right: f64::from(WIDTH) - PAD - 8.0, top, bottom: top + height };
                let fitted = || range(panel.series.iter().flat_map(Series::y), panel.min_span, 0.06);
                View { area, x, y: panel.y_range.unwrap_or_else(fitted) }
            })
            .collect();
        let left = left_border(views.iter());
        views.iter_mut().for_each(|view| view.area.left = left);
        views
    }
}

impl Panel {
    fn draw(&self, sheet: &mut Sheet, view: &View, lowest: bool) {
        let axes = Axes::of(view);
        for series in &self.series {
            if let Shape::Band(points) = &series.shape {
                draw_band(sheet, view, points, light(series.stroke.colour));
            }
        }
        axes.grid(sheet, view);
        for series in &self.series {
            if let Shape::Line(points) = &series.shape {
                sheet.polyline(points.iter().map(|point| view.place(*point)), &series.stroke, view.area);
            }
        }
        axes.frame(sheet, view, lowest);
        let middle = f64::midpoint(view.area.top, view.area.bottom);
        sheet.text_upwards([PAD + 8.0, middle], LABEL, INK, &self.y_label);
    }
}

/// Thin columns between the two edges.
fn draw_band(sheet: &mut Sheet, view: &View, points: &[[f64; 3]], colour: Colour) {
    const COLUMN: f64 = 1.0 / 3.0;
    let area = view.area;
    for pair in points.windows(2) {
        let [a, b] = pair else { continue };
        if a.iter().chain(b).any(|value| !value.is_finite()) {
            continue;
        }
        let place = |[x, low, high]: [f64; 3]| (view.place([x, low]), view.place([x, high])[1]);
        let (([x0, low0], high0), ([x1, low1], high1)) = (place(*a), place(*b));
        let (from, to) = (x0.max(area.left), x1.min(area.right));
        let columns = ((to - from) / COLUMN).ceil().max(0.0) as u32;
        for left in (0..columns).map(|i| from + f64::from(i) * COLUMN) {
            let share = if x1 > x0 { (left - x0) / (x1 - x0) } else { 0.0 };
            let (low, high) = (low0 + (low1 - low0) * share, high0 + (high1 - high0) * share);
            let (top, bottom) = (high.min(low).max(area.top), low.max(high).min(area.bottom));
            sheet.fill(Area { left, right: left + COLUMN, top, bottom }, colour);
        }
    }
}

/// The left border that leaves the numbers and the label room.
pub(crate) fn left_border<'a>(views: impl Iterator<Item = &'a View>) -> f64 {
    PAD + 24.0 + views.map(|view| Axes::of(view).y_gutter()).fold(0.0, f64::max)
}

pub(crate) fn title_height(title: &str) -> f64 {
    if title.is_empty() { 0.0 } else { 34.0 }
}

pub(crate) fn draw_title(sheet: &mut Sheet, title: &str) {
    sheet.text([PAD, PAD + 10.0], Align::Left, TITLE, INK, title);
}

fn light(colour: Colour) -> Colour {
    colour.map(|value| (255.0 - (255.0 - f64::from(value)) * 0.28).round() as u8)
}

#[cfg(test)]
mod tests;

//! A canvas for charts: fractions of pixels, smooth edges.

use evac_formats::rgb_image::RgbImage;

use crate::area::Area;
use crate::lettering::{self, Align};
use crate::{Canvas, Colour, Frame, Stroke};

/// Drawn pixels along each side of a pixel of the picture.
const FINE: i64 = 3;

/// A chart that is being drawn.
pub(crate) struct Sheet {
    canvas: Canvas,
}

impl Sheet {
    pub(crate) fn new(width: u32, height: u32) -> Self {
        Self { canvas: Canvas::new(width * FINE as u32, height * FINE as u32, [255, 255, 255]) }
    }

    /// The picture, each pixel the mean of the drawn ones.
    pub(crate) fn finish(self) -> RgbImage {
        let fine = self.canvas.into_image();
        let mut image = RgbImage::new(fine.width() / FINE as u32, fine.height() / FINE as u32, [0; 3]);
        let (width, height) = (i64::from(image.width()), i64::from(image.height()));
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let mut sum = [0_u32; 3];
            for (dx, dy) in (0..FINE).flat_map(|dy| (0..FINE).map(move |dx| (dx, dy))) {
                let colour = fine.get(x * FINE + dx, y * FINE + dy).unwrap_or_default();
                sum.iter_mut().zip(colour).for_each(|(sum, value)| *sum += u32::from(value));
            }
            image.set(x, y, sum.map(|sum| (sum as f64 / (FINE * FINE) as f64).round() as u8));
        }
        image
    }

    pub(crate) fn fill(&mut self, area: Area, colour: Colour) {
        self.canvas.fill(frame(area), colour);
    }

    pub(crate) fn outline(&mut self, area: Area, width: f64, colour: Colour) {
        self.canvas.outline(frame(area), (width * FINE as f64).round().max(1.0) as i64, colour);
    }

    pub(crate) fn disc(&mut self, at: [f64; 2], radius: f64, colour: Colour) {
        self.canvas.disc(at.map(fine), fine(radius), colour);
    }

    pub(crate) fn line(&mut self, a: [f64; 2], b: [f64; 2], width: f64, colour: Colour) {
        self.canvas.line(a.map(fine), b.map(fine), fine(width), colour);
    }

    /// A line through points inside an area; one that is not finite interrupts it.
    pub(crate) fn polyline(&mut self, points: impl Iterator<Item = [f64; 2]>, stroke: &Stroke, area: Area) {
        self.canvas.clip(frame(area));
        let reach = area.grown(stroke.width);
        let (mut before, mut done) = (None::<[f64; 2]>, 0.0);
        for point in points {
            let here = point.iter().all(|value| value.is_finite()).then_some(point);
            if let (Some(a), Some(b)) = (before, here)
                && let Some([from, to]) = reach.clip(a, b)
            {
                done = self.dashes(from, to, stroke, done);
            }
            before = here;
        }
        self.canvas.unclip();
    }

    /// Draws a segment `done` pixels behind the line's start, and gives how far it has come.
    fn dashes(&mut self, a: [f64; 2], b: [f64; 2], stroke: &Stroke, done: f64) -> f64 {
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        let at = |way: f64| {
            let share = if length > 0.0 { way / length } else { 0.0 };
            [a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share]
        };
        let Some([drawn, left_out]) = stroke.dash else {
            self.line(a, b, stroke.width, stroke.colour);
            return done;
        };
        let period = (drawn + left_out).max(1.0);
        let mut start = -(done % period);
        while start < length {
            let (from, to) = (start.max(0.0), (start + drawn).min(length));
            if from < to {
                self.line(at(from), at(to), stroke.width, stroke.colour);
            }
            start += period;
        }
        (done + length) % period
    }

    /// A text whose capitals' middle is at `at`; `size` is pixels a dot of the font, a capital has 7.
    pub(crate) fn text(&mut self, at: [f64; 2], align: Align, size: f64, colour: Colour, text: &str) {
        for stroke in lettering::strokes(text, align) {
            let [a, b] = stroke.map(|[x, y]| [at[0] + x * size, at[1] + y * size]);
            self.line(a, b, lettering::WEIGHT * size, colour);
        }
    }

    /// A text that is read from below to above, its middle at `at`.
    pub(crate) fn text_upwards(&mut self, at: [f64; 2], size: f64, colour: Colour, text: &str) {
        for stroke in lettering::strokes(text, Align::Centre) {
            let [a, b] = stroke.map(|[x, y]| [at[0] + y * size, at[1] - x * size]);
            self.line(a, b, lettering::WEIGHT * size, colour);
        }
    }
}

fn fine(value: f64) -> f64 {
    value * FINE as f64
}

fn frame(area: Area) -> Frame {
    let [left, top, right, bottom] =
        [area.left, area.top, area.right, area.bottom].map(|value| fine(value).round() as i64);
    Frame { left, top, right, bottom }
}

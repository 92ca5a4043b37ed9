//! What a chart's lines and marks are called.

use crate::area::Area;
use crate::axes::{INK, LABEL};
use crate::lettering::{self, Align};
use crate::sheet::Sheet;
use crate::{Colour, Stroke};

/// What stands before a name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Sign {
    Line(Stroke),
    Band(Colour),
    Start(Colour),
    End(Colour),
}

/// Height of a row, pixels.
pub(crate) const ROW: f64 = 26.0;
const SIGN_WIDTH: f64 = 38.0;
const GAP: f64 = 26.0;

/// Signs with their names, in rows.
pub(crate) struct Legend {
    rows: Vec<Vec<(f64, Sign, String)>>,
}

impl Legend {
    /// Rows of at most `width` pixels.
    pub(crate) fn new(entries: impl IntoIterator<Item = (Sign, String)>, width: f64) -> Self {
        let mut rows: Vec<Vec<_>> = Vec::new();
        let mut left = f64::INFINITY;
        for (sign, name) in entries {
            let entry_width = sign_width(&sign) + 8.0 + lettering::width(&name) * LABEL;
            if left + entry_width > width {
                rows.push(Vec::new());
                left = 0.0;
            }
            if let Some(row) = rows.last_mut() {
                row.push((left, sign, name));
            }
            left += entry_width + GAP;
        }
        Self { rows }
    }

    /// Pixels.
    pub(crate) fn height(&self) -> f64 {
        self.rows.len() as f64 * ROW
    }

    pub(crate) fn draw(&self, sheet: &mut Sheet, left: f64, top: f64) {
        for (row, number) in self.rows.iter().zip(0..) {
            let y = top + (f64::from(number) + 0.5) * ROW;
            for (offset, sign, name) in row {
                let x = left + offset;
                draw_sign(sheet, sign, [x, y]);
                sheet.text([x + sign_width(sign) + 8.0, y], Align::Left, LABEL, INK, name);
            }
        }
    }
}

fn sign_width(sign: &Sign) -> f64 {
    match sign {
        Sign::Line(_) | Sign::Band(_) => SIGN_WIDTH,
        Sign::Start(_) | Sign::End(_) => 18.0,
    }
}

fn draw_sign(sheet: &mut Sheet, sign: &Sign, [x, y]: [f64; 2]) {
    let area = Area { left: x, right: x + SIGN_WIDTH, top: y - 7.0, bottom: y + 7.0 };
    match sign {
        Sign::Line(stroke) => sheet.polyline([[x, y], [x + SIGN_WIDTH, y]].into_iter(), stroke, area),
        Sign::Band(colour) => sheet.fill(area, *colour),
        Sign::Start(colour) => start(sheet, [x + 9.0, y], *colour),
        Sign::End(colour) => end(sheet, [x + 9.0, y], *colour),
    }
}

/// A ring, so that it stays visible around an end at the same place.
pub(crate) fn start(sheet: &mut Sheet, at: [f64; 2], colour: Colour) {
    for (radius, colour) in [(11.0, WHITE), (10.0, colour), (7.5, WHITE)] {
        sheet.disc(at, radius, colour);
    }
}

/// A square.
pub(crate) fn end(sheet: &mut Sheet, [x, y]: [f64; 2], colour: Colour) {
    for (half, colour) in [(6.0, WHITE), (4.7, colour)] {
        sheet.fill(Area { left: x - half, right: x + half, top: y - half, bottom: y + half }, colour);
    }
}

const WHITE: Colour = [255, 255, 255];

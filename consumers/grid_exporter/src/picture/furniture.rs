//! What stands around the map: scale bar, axes and legend.

use evac_formats::occupancy_grid::{FREE, OCCUPIED, UNKNOWN};
use evac_picture::{Canvas, Frame, text_height, text_width};

use super::map::{self, MapView};
use super::{INK, PAPER, PATH_FIRST, PATH_LAST};

/// What a sign of the legend shows.
#[derive(Debug, Clone, Copy)]
pub(super) enum Sign {
    Cell(i8),
    Path,
    Start,
    End,
}

const LEGEND: [(Sign, &str); 6] = [
    (Sign::Cell(OCCUPIED), "wall or obstacle"),
    (Sign::Cell(FREE), "free"),
    (Sign::Cell(UNKNOWN), "unknown"),
    (Sign::Path, "path walked"),
    (Sign::Start, "start"),
    (Sign::End, "end"),
];

/// Width of a sign, dots.
const SIGN: i64 = 24;

/// One entry with its distance from the legend's left border.
pub(super) type Entry = (i64, Sign, &'static str);

/// The legend's entries, row by row, as they fit the width.
pub(super) fn legend_rows(dot: i64, width: i64) -> Vec<Vec<Entry>> {
    let mut rows: Vec<Vec<Entry>> = vec![Vec::new()];
    let mut left = 0;
    for (sign, text) in LEGEND {
        let entry_width = (SIGN + 6) * dot + text_width(text, dot);
        if left + entry_width > width {
            rows.push(Vec::new());
            left = 0;
        }
        if let Some(row) = rows.last_mut() {
            row.push((left, sign, text));
        }
        left += entry_width + 16 * dot;
    }
    rows
}

pub(super) fn legend(canvas: &mut Canvas, rows: &[Vec<Entry>], left: i64, top: i64, dot: i64) {
    for (row, number) in rows.iter().zip(0..) {
        let top = top + number * 24 * dot;
        for (offset, sign, text) in row {
            let x = left + offset;
            draw_sign(
                canvas,
                *sign,
                Frame { left: x, top, right: x + SIGN * dot, bottom: top + 14 * dot },
                dot,
            );
            let text_top = top + 7 * dot - text_height(dot) / 2;
            canvas.text(x + (SIGN + 6) * dot, text_top, dot, INK, text);
        }
    }
}

fn draw_sign(canvas: &mut Canvas, sign: Sign, frame: Frame, dot: i64) {
    let y = (frame.top + frame.bottom) as f64 / 2.0;
    let (left, right) = (frame.left as f64, frame.right as f64);
    let middle = [(left + right) / 2.0, y];
    match sign {
        Sign::Cell(cell) => {
            for (x, y) in
                (frame.top..frame.bottom).flat_map(|y| (frame.left..frame.right).map(move |x| (x, y)))
            {
                canvas.pixel(x, y, map::colour(cell, x, y, dot));
            }
            canvas.outline(frame, (dot / 2).max(1), INK);
        }
        Sign::Path => {
            canvas.line([left, y], middle, 1.6 * dot as f64, PATH_FIRST);
            canvas.line(middle, [right, y], 1.6 * dot as f64, PATH_LAST);
            canvas.arrow_head([middle[0] + 3.0 * dot as f64, y], [1.0, 0.0], 6.0 * dot as f64, PATH_LAST);
        }
        Sign::Start => map::start_marker(canvas, middle, dot),
        Sign::End => map::end_marker(canvas, middle, dot),
    }
}

/// Four fields, dark and light in turn, with metres at both ends and in the middle.
pub(super) fn scale_bar(canvas: &mut Canvas, view: &MapView<'_>, left: i64, top: i64) {
    let dot = view.dot;
    let length = view.round_length(110.0 * dot as f64);
    let at = |share: f64| left + (length * share * view.metre()).round() as i64;
    let bar = Frame { left, top: top + 12 * dot, right: at(1.0), bottom: top + 16 * dot };
    for (field, share) in [0.0, 0.25, 0.5, 0.75].into_iter().enumerate() {
        let colour = if field % 2 == 0 { INK } else { PAPER };
        canvas.fill(Frame { left: at(share), right: at(share + 0.25), ..bar }, colour);
    }
    canvas.outline(bar, (dot / 2).max(1), INK);
    canvas.text(left, top, dot, INK, "0");
    let middle = format!("{}", length / 2.0);
    canvas.text(at(0.5) - text_width(&middle, dot) / 2, top, dot, INK, &middle);
    let end = format!("{length} m");
    canvas.text(at(1.0) - text_width("0", dot) / 2, top, dot, INK, &end);
}

/// The directions of the map frame's axes; which way is north no sensor of the rig knows.
pub(super) fn axes(canvas: &mut Canvas, right: i64, bottom: i64, dot: i64) {
    let arm = 18.0 * dot as f64;
    let width = 1.5 * dot as f64;
    let origin = [(right - 30 * dot) as f64, (bottom - 8 * dot) as f64];
    let (x, y) = ([origin[0] + arm, origin[1]], [origin[0], origin[1] - arm]);
    canvas.line(origin, x, width, INK);
    canvas.arrow_head([x[0] + 3.0 * dot as f64, x[1]], [1.0, 0.0], 6.0 * dot as f64, INK);
    canvas.line(origin, y, width, INK);
    canvas.arrow_head([y[0], y[1] - 3.0 * dot as f64], [0.0, -1.0], 6.0 * dot as f64, INK);
    canvas.text(x[0] as i64 + 5 * dot, x[1] as i64 - 4 * dot, dot, INK, "x");
    canvas.text(y[0] as i64 + 5 * dot, y[1] as i64 - 5 * dot, dot, INK, "y");
}

//! A frame's passage as a waterfall.

use evac_formats::rgb_image::RgbImage;
use evac_picture::{Canvas, Colour, Frame, text_height, text_width};

use crate::trace::passage::Passage;

const SCALE: i64 = 2;
const ROW: i64 = 34;
const LEFT: i64 = 230;
const WIDTH: i64 = 1200;
const PAD: i64 = 20;
const INK: Colour = [40, 40, 40];
const HOP: Colour = [214, 96, 77];
const WAIT: Colour = [190, 190, 190];
const COMPUTE: Colour = [67, 147, 195];

/// One row a stage, time to the right.
pub(super) fn draw(passage: &Passage) -> RgbImage {
    let rows = passage.hops.len() as i64;
    let (top, right) = (PAD + 2 * ROW, WIDTH - PAD - 90);
    let height = top + rows * ROW + 2 * ROW;
    let mut canvas = Canvas::new(WIDTH as u32, height as u32, [255, 255, 255]);
    let title =
        format!("frame {}: {:.2} ms from its last byte to the last stage", passage.seq, passage.end());
    canvas.text(PAD, PAD, SCALE, INK, &title);
    let mut x = PAD;
    for (colour, name) in [(HOP, "hop"), (WAIT, "waiting"), (COMPUTE, "computing")] {
        canvas.fill(Frame { left: x, top: PAD + ROW, right: x + 18, bottom: PAD + ROW + 14 }, colour);
        canvas.text(x + 26, PAD + ROW, SCALE, INK, name);
        x += 26 + text_width(name, SCALE) + 30;
    }
    let scale = (right - LEFT) as f64 / passage.end().max(1e-9);
    let at = |ms: f64| LEFT + (ms.max(0.0) * scale).round() as i64;
    for (row, hop) in (0..).zip(&passage.hops) {
        let y = top + row * ROW;
        canvas.text(PAD, y + (ROW - text_height(SCALE)) / 2, SCALE, INK, &hop.stage);
        for (from, to, colour) in
            [(hop.sent, hop.received, HOP), (hop.received, hop.begun, WAIT), (hop.begun, hop.done, COMPUTE)]
        {
            // However short, it is seen.
            let (left, right) = (at(from), at(to).max(at(from) + 2));
            canvas.fill(Frame { left, top: y + 6, right, bottom: y + ROW - 6 }, colour);
        }
        canvas.text(
            at(hop.done) + 8,
            y + (ROW - text_height(SCALE)) / 2,
            SCALE,
            INK,
            &format!("{:.2}", hop.done),
        );
    }
    let bottom = top + rows * ROW + 8;
    canvas.fill(Frame { left: LEFT, top: bottom, right, bottom: bottom + 2 }, INK);
    for tick in 0..=4 {
        let ms = passage.end() * f64::from(tick) / 4.0;
        let label = format!("{ms:.1} ms");
        canvas.fill(Frame { left: at(ms), top: bottom, right: at(ms) + 2, bottom: bottom + 8 }, INK);
        canvas.text(at(ms) - text_width(&label, SCALE) / 2, bottom + 14, SCALE, INK, &label);
    }
    canvas.into_image()
}

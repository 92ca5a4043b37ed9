//! Maps from above, side by side: the highest occupied voxel of each column below head height, coloured by height.

use evac_formats::rgb_image::RgbImage;
use evac_octree::OctreeMap;
use evac_picture::{Canvas, Colour, Frame, text_height};

use crate::convert::output::centres;

/// Size of a panel's map, pixels.
const PANEL: [i64; 2] = [640, 400];
const PAD: i64 = 14;
const DOT: i64 = 2;
const PAPER: Colour = [255, 255, 255];
const INK: Colour = [34, 34, 34];
/// What is higher over the lowest tenth of the voxels is left out, metres: ceilings would hide all else.
const CUT_M: f32 = 2.6;

/// The voxels of a map that are seen from above.
#[derive(Debug)]
pub(super) struct Panel {
    resolution: f64,
    centres: Vec<[f32; 3]>,
    low: f32,
}

impl Panel {
    pub(super) fn of(map: &OctreeMap) -> Self {
        let mut heights: Vec<f32> = Vec::new();
        let mut all: Vec<[f32; 3]> = centres(map).iter().map(|point| [point.x, point.y, point.z]).collect();
        heights.extend(all.iter().map(|point| point[2]));
        heights.sort_unstable_by(f32::total_cmp);
        let low = heights.get(heights.len() / 10).copied().unwrap_or_default();
        all.retain(|point| point[2] <= low + CUT_M);
        all.sort_unstable_by(|a, b| a[2].total_cmp(&b[2]));
        Self { resolution: map.space().resolution(), centres: all, low }
    }
}

/// Two panels a column, three a row, all at the same scale.
pub(super) fn draw(panels: &[(String, &Panel)]) -> RgbImage {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for (point, half) in
        panels.iter().flat_map(|(_, panel)| panel.centres.iter().map(|point| (point, 0.5 * panel.resolution)))
    {
        for axis in 0..2 {
            low[axis] = low[axis].min(f64::from(point[axis]) - half);
            high[axis] = high[axis].max(f64::from(point[axis]) + half);
        }
    }
    let scale =
        (0..2).map(|axis| PANEL[axis] as f64 / (high[axis] - low[axis])).fold(f64::INFINITY, f64::min);
    let used =
        [0, 1].map(|axis| if scale.is_finite() { ((high[axis] - low[axis]) * scale) as i64 + 1 } else { 1 });
    let title = text_height(DOT) + PAD;
    let (columns, rows) = (3, (panels.len() as i64 + 2) / 3);
    let width = columns * (used[0] + PAD) + PAD;
    let height = rows * (used[1] + title + PAD) + PAD;
    let mut canvas = Canvas::new(width as u32, height as u32, PAPER);
    for ((name, panel), index) in panels.iter().zip(0..) {
        let left = PAD + index % columns * (used[0] + PAD);
        let top = PAD + index / columns * (used[1] + title + PAD);
        canvas.text(left, top, DOT, INK, name);
        let frame = Frame { left, top: top + title, right: left + used[0], bottom: top + title + used[1] };
        canvas.fill(frame, [238, 239, 241]);
        canvas.clip(frame);
        // Lowest first, so that the highest is seen.
        for point in &panel.centres {
            let half = 0.5 * panel.resolution;
            let [x, y] = [f64::from(point[0]), f64::from(point[1])];
            let across = |value: f64| frame.left + ((value - low[0]) * scale).round() as i64;
            let down = |value: f64| frame.bottom - ((value - low[1]) * scale).round() as i64;
            let square = Frame {
                left: across(x - half),
                right: across(x + half),
                top: down(y + half),
                bottom: down(y - half),
            };
            canvas.fill(square, colour((point[2] - panel.low) / CUT_M));
        }
        canvas.unclip();
    }
    canvas.into_image()
}

/// From blue (low) over green to red (high).
fn colour(share: f32) -> Colour {
    let stops: [[f32; 3]; 4] =
        [[40.0, 60.0, 140.0], [40.0, 150.0, 150.0], [230.0, 180.0, 50.0], [190.0, 40.0, 40.0]];
    let at = share.clamp(0.0, 1.0) * 2.999;
    let (from, part) = (at as usize, at.fract());
    std::array::from_fn(|k| (stops[from][k] + part * (stops[from + 1][k] - stops[from][k])) as u8)
}

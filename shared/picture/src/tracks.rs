//! Walked tracks: from above, and coordinate by coordinate over time (Figures 8b and 9 of the paper).

use std::path::Path;

use evac_formats::FormatError;
use evac_formats::rgb_image::RgbImage;

use crate::area::{Area, View, range};
use crate::axes::{Axes, INK, LABEL, NUMBER};
use crate::chart::{PAD, WIDTH, draw_title, left_border, title_height};
use crate::legend::{self, Legend, Sign};
use crate::lettering::Align;
use crate::sheet::Sheet;
use crate::ticks::round_up;
use crate::{LineChart, Panel, Series, Stroke};

/// Height of the map, pixels: it follows the tracks' shape within these.
const MAP_HEIGHT: [f64; 2] = [320.0, 860.0];
/// Height of the axes over time is blown up no further than to this, metres.
const MIN_SPAN_M: f64 = 0.1;

/// One track.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Name in the legend.
    pub name: String,
    /// How it looks: [`Stroke::truth`] or [`Stroke::nth`].
    pub stroke: Stroke,
    /// Its points, in the order of time.
    pub points: Vec<TrackPoint>,
}

/// Where a track is at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPoint {
    /// Seconds; all tracks of a picture count from the same moment.
    pub time_s: f64,
    /// Metres, z up; all tracks of a picture in the same frame.
    pub position: [f64; 3],
}

/// Draws tracks from above into a PNG file: equal axes in metres, a scale, start and ends marked.
///
/// # Errors
/// [`FormatError::Io`] naming `path`.
pub fn plot_paths(path: &Path, title: &str, tracks: &[Track]) -> Result<(), FormatError> {
    draw_paths(title, tracks).write_png(path)
}

/// Draws x, y and z of tracks over time into a PNG file.
///
/// # Errors
/// [`FormatError::Io`] naming `path`.
pub fn plot_axes(path: &Path, title: &str, tracks: &[Track]) -> Result<(), FormatError> {
    crate::line_chart(path, &axes_chart(title, tracks))
}

fn axes_chart(title: &str, tracks: &[Track]) -> LineChart {
    let panel = |(axis, y_label): (usize, &str)| Panel {
        y_label: y_label.to_owned(),
        y_range: None,
        min_span: MIN_SPAN_M,
        series: tracks.iter().map(|track| series(track, axis)).collect(),
    };
    let panels = [(0, "x (m)"), (1, "y (m)"), (2, "z (m)")].map(panel).to_vec();
    LineChart { title: title.to_owned(), x_label: "time (s)".to_owned(), panels }
}

fn series(track: &Track, axis: usize) -> Series {
    let value = |point: &TrackPoint| point.position.get(axis).copied().unwrap_or(f64::NAN);
    let points = track.points.iter().map(|point| [point.time_s, value(point)]).collect();
    Series::line(track.name.clone(), track.stroke, points)
}

fn draw_paths(title: &str, tracks: &[Track]) -> RgbImage {
    let signs = [(Sign::Start(INK), "start".to_owned()), (Sign::End(INK), "end".to_owned())];
    let lines = tracks.iter().map(|track| (Sign::Line(track.stroke), track.name.clone()));
    let legend = Legend::new(lines.chain(signs), f64::from(WIDTH) - 2.0 * PAD);
    let top = PAD + title_height(title) + legend.height() + 8.0;
    let view = view(tracks, top);

    let bottom = view.area.bottom;
    let mut sheet = Sheet::new(WIDTH, (bottom + 64.0).ceil() as u32);
    draw_title(&mut sheet, title);
    legend.draw(&mut sheet, PAD, PAD + title_height(title));
    let axes = Axes::equal(&view);
    axes.grid(&mut sheet, &view);
    for track in tracks {
        sheet.polyline(track.points.iter().map(|point| place(&view, point)), &track.stroke, view.area);
    }
    draw_starts(&mut sheet, &view, tracks);
    for track in tracks {
        if let Some(last) = track.points.last().map(|point| place(&view, point)) {
            legend::end(&mut sheet, last, track.stroke.colour);
        }
    }
    axes.frame(&mut sheet, &view, true);
    let middle = [f64::midpoint(view.area.left, view.area.right), f64::midpoint(view.area.top, bottom)];
    sheet.text([middle[0], bottom + 44.0], Align::Centre, LABEL, INK, "x (m)");
    sheet.text_upwards([PAD + 8.0, middle[1]], LABEL, INK, "y (m)");
    scale_bar(&mut sheet, &view);
    sheet.finish()
}

/// One start where the tracks begin together, else one each.
fn draw_starts(sheet: &mut Sheet, view: &View, tracks: &[Track]) {
    let starts = || {
        let start = |track: &Track| Some((place(view, track.points.first()?), track.stroke.colour));
        tracks.iter().filter_map(start)
    };
    let Some((first, _)) = starts().next() else { return };
    let apart = |[x, y]: [f64; 2]| (x - first[0]).hypot(y - first[1]) > 4.0;
    for (at, colour) in starts().filter(|(at, _)| apart(*at)) {
        legend::start(sheet, at, colour);
    }
    legend::start(sheet, first, INK);
}

fn place(view: &View, point: &TrackPoint) -> [f64; 2] {
    let [x, y, _] = point.position;
    view.place([x, y])
}

/// The map's place on the picture: a metre is as long in x as in y.
fn view(tracks: &[Track], top: f64) -> View {
    let points = || tracks.iter().flat_map(|track| &track.points).map(|point| point.position);
    let x = range(points().map(|[x, ..]| x), 1.0, 0.05);
    let y = range(points().map(|[_, y, _]| y), 1.0, 0.05);
    let span = |[low, high]: [f64; 2]| high - low;
    let right = f64::from(WIDTH) - PAD - 8.0;
    let place = |left: f64| {
        let width = right - left;
        let height = (width * span(y) / span(x)).clamp(MAP_HEIGHT[0], MAP_HEIGHT[1]);
        let metres = (span(x) / width).max(span(y) / height);
        let around = |range: [f64; 2], pixels: f64| {
            let middle = f64::midpoint(range[0], range[1]);
            [middle - metres * pixels / 2.0, middle + metres * pixels / 2.0]
        };
        let area = Area { left, right, top, bottom: top + height };
        View { area, x: around(x, width), y: around(y, height) }
    };
    // The room of the numbers depends on them, and they hardly on the room.
    place(left_border([place(80.0)].iter()))
}

/// A round length at the lower right, beside the x axis's label.
fn scale_bar(sheet: &mut Sheet, view: &View) {
    let metre = view.area.width() / (view.x[1] - view.x[0]);
    let length = round_up(70.0 / metre);
    let (right, y) = (view.area.right, view.area.bottom + 46.0);
    let left = right - length * metre;
    let bar = Area { left, right, top: y - 2.0, bottom: y + 2.0 };
    sheet.fill(bar, INK);
    for x in [left, right] {
        sheet.fill(Area { left: x - 1.0, right: x + 1.0, top: y - 6.0, bottom: y + 6.0 }, INK);
    }
    sheet.text([left - 8.0, y], Align::Right, NUMBER, INK, &format!("{length} m"));
}

#[cfg(test)]
mod tests {
    use super::*;

    const STROKE: Stroke = Stroke { colour: [200, 0, 100], width: 2.0, dash: None };

    fn track(corners: &[[f64; 2]]) -> Track {
        let point =
            |(i, [x, y]): (usize, &[f64; 2])| TrackPoint { time_s: i as f64, position: [*x, *y, 0.0] };
        Track {
            name: "a".to_owned(),
            stroke: STROKE,
            points: corners.iter().enumerate().map(point).collect(),
        }
    }

    /// The track's pixels.
    fn drawn(image: &RgbImage) -> Vec<[i64; 2]> {
        let (width, height) = (i64::from(image.width()), i64::from(image.height()));
        // The legend is above.
        let all = (70..height).flat_map(|y| (0..width).map(move |x| [x, y]));
        all.filter(|[x, y]| image.get(*x, *y) == Some(STROKE.colour)).collect()
    }

    /// Its first and last columns and rows.
    fn extent(image: &RgbImage) -> [[i64; 2]; 2] {
        let drawn = drawn(image);
        [0, 1].map(|axis| {
            let values = || drawn.iter().map(|pixel| pixel[axis]);
            [values().min().unwrap(), values().max().unwrap()]
        })
    }

    #[test]
    fn a_metre_is_as_long_in_x_as_in_y() {
        // Ends in the middle, so that the marks are inside.
        let square =
            track(&[[5.0, 5.0], [0.0, 5.0], [0.0, 10.0], [10.0, 10.0], [10.0, 0.0], [0.0, 0.0], [5.0, 5.0]]);
        let [[left, right], [top, bottom]] = extent(&draw_paths("", &[square]));
        assert!(((right - left) - (bottom - top)).abs() <= 1, "{left} to {right}, {top} to {bottom}");
        assert!(bottom - top > 600);
    }

    #[test]
    fn a_walk_to_the_right_and_then_up_leaves_the_upper_left_empty() {
        let image = draw_paths("", &[track(&[[0.0, 0.0], [20.0, 0.0], [20.0, 10.0]])]);
        let drawn = drawn(&image);
        let [[left, right], [top, bottom]] = extent(&image);
        let (x, y) = (i64::midpoint(left, right), i64::midpoint(top, bottom));
        assert!(drawn.iter().any(|p| p[0] > x && p[1] < y) && drawn.iter().any(|p| p[0] < x && p[1] > y));
        assert!(!drawn.iter().any(|p| p[0] < x && p[1] < y));
    }

    #[test]
    fn a_corridor_a_kilometre_long_and_a_point_give_pictures_of_bounded_size() {
        for corners in [&[[0.0, 0.0], [1000.0, 1.0]][..], &[[0.0, 0.0], [1.0, 1000.0]], &[[3.0, 3.0]], &[]] {
            let image = draw_paths("", &[track(corners)]);
            assert_eq!(image.width(), WIDTH);
            assert!((400..1100).contains(&image.height()), "{corners:?}: {}", image.height());
        }
    }

    #[test]
    fn both_files_are_written() {
        let folder = tempfile::tempdir().unwrap();
        let tracks = [track(&[[0.0, 0.0], [1.0, 2.0]])];
        plot_paths(&folder.path().join("path.png"), "Path", &tracks).unwrap();
        plot_axes(&folder.path().join("axes.png"), "Axes", &tracks).unwrap();
        let missing = plot_axes(&folder.path().join("no/axes.png"), "Axes", &tracks).unwrap_err();
        assert!(missing.to_string().contains("create the folder"), "{missing}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}

//! Charts, pixel by pixel.

use super::*;

const STROKE: Stroke = Stroke { colour: [200, 0, 100], width: 2.0, dash: None };

fn chart(shape: Shape) -> LineChart {
    let series = vec![Series { name: String::new(), stroke: STROKE, shape }];
    let panel = Panel { y_label: "y".to_owned(), y_range: Some([0.0, 2.0]), min_span: 0.0, series };
    LineChart { title: String::new(), x_label: "x".to_owned(), panels: vec![panel] }
}

/// The pixels of a colour.
fn pixels(image: &RgbImage, colour: Colour) -> Vec<[i64; 2]> {
    let (width, height) = (i64::from(image.width()), i64::from(image.height()));
    let all = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
    all.filter(|[x, y]| image.get(*x, *y) == Some(colour)).collect()
}

/// The one panel's frame: no title and no legend above it.
fn middle() -> f64 {
    PAD + 8.0 + PANEL_HEIGHTS[0] / 2.0
}

#[test]
fn a_value_in_the_middle_of_the_range_is_drawn_in_the_middle_of_the_panel() {
    let image = chart(Shape::Line(vec![[0.0, 1.0], [10.0, 1.0]])).draw();
    let line = pixels(&image, STROKE.colour);
    let mean = line.iter().map(|[_, y]| *y as f64 + 0.5).sum::<f64>() / line.len() as f64;
    assert!((mean - middle()).abs() <= 0.5, "{mean}, not {}", middle());
    assert!(line.len() > 1000);
}

#[test]
fn a_value_that_is_none_interrupts_the_line() {
    let whole: Vec<_> = (0..=10).map(|i| [f64::from(i), 1.0]).collect();
    let mut broken = whole.clone();
    broken[5][1] = f64::NAN;
    let length = |points: Vec<[f64; 2]>| pixels(&chart(Shape::Line(points)).draw(), STROKE.colour).len();
    let (whole, broken) = (length(whole), length(broken));
    // Two of ten segments are gone.
    assert!((broken as f64 / whole as f64 - 0.8).abs() < 0.01, "{broken} of {whole}");
}

#[test]
fn what_is_far_outside_a_fixed_range_is_cut_off_at_the_frame() {
    let image = chart(Shape::Line(vec![[0.0, 1.0], [5.0, 1e15], [10.0, -1e15]])).draw();
    let half = PANEL_HEIGHTS[0] / 2.0 + 1.0;
    let line = pixels(&image, STROKE.colour);
    assert!(!line.is_empty() && line.iter().all(|[_, y]| (*y as f64 - middle()).abs() <= half));
}

#[test]
fn a_band_fills_what_is_between_its_edges() {
    let image = chart(Shape::Band(vec![[0.0, 0.5, 1.5], [10.0, 0.5, 1.5]])).draw();
    let rows = pixels(&image, light(STROKE.colour)).into_iter().filter(|[x, _]| *x == 613).count();
    // Half of the panel, less the lines of the grid.
    assert!((250..=261).contains(&rows), "{rows} rows");
}

#[test]
fn a_dashed_line_is_drawn_for_its_share_of_the_way() {
    let length = |stroke: Stroke| {
        let mut chart = chart(Shape::Line((0..=100).map(|i| [f64::from(i), 1.0]).collect()));
        chart.panels[0].series[0].stroke = stroke;
        pixels(&chart.draw(), STROKE.colour).len() as f64
    };
    let share = length(Stroke { dash: Some([20.0, 20.0]), ..STROKE }) / length(STROKE);
    // Round ends add a little to each dash.
    assert!((0.5..0.56).contains(&share), "{share}");
}

#[test]
fn a_name_that_several_panels_share_stands_in_the_legend_once() {
    let mut chart = chart(Shape::Line(vec![[0.0, 1.0], [1.0, 1.0]]));
    chart.panels[0].series[0].name = "truth".to_owned();
    let one = chart.legend().height();
    chart.panels = vec![chart.panels[0].clone(); 30];
    assert_eq!(chart.legend().height(), one);
}

#[test]
fn nothing_to_show_is_an_empty_chart() {
    let chart = LineChart { title: String::new(), x_label: String::new(), panels: Vec::new() };
    assert_eq!(chart.draw().width(), WIDTH);
    let empty = LineChart { panels: vec![Panel::default(); 2], ..chart };
    assert_eq!(empty.draw(), empty.draw());
}

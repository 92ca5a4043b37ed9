//! Pictures for people: a canvas, line charts, and walked paths from above.
//!
//! - [`Canvas`]: whole pixels, for maps whose cells must stay exact.
//! - [`LineChart`] and [`line_chart`]: panels over one x axis, with lines and bands (memory over time, an error and
//!   its three sigma).
//! - [`plot_paths`] and [`plot_axes`]: tracks from above, and their x, y and z over time (Figures 8 and 9 of the paper).
//!
//! ```no_run
//! use std::path::Path;
//!
//! use evac_picture::{LineChart, Panel, Series, Stroke, line_chart};
//!
//! let panel = Panel {
//!     y_label: "error (m)".to_owned(),
//!     series: vec![
//!         Series::band("3σ", Stroke::nth(0), vec![[0.0, -0.03, 0.03], [60.0, -0.06, 0.06]]),
//!         Series::line("error", Stroke::nth(1), vec![[0.0, 0.0], [60.0, 0.02]]),
//!     ],
//!     ..Panel::default()
//! };
//! let chart = LineChart { title: "Error in x".to_owned(), x_label: "time (s)".to_owned(), panels: vec![panel] };
//! line_chart(Path::new("error.png"), &chart)?;
//! # Ok::<(), evac_formats::FormatError>(())
//! ```
//!
//! Charts are drawn three times as large and averaged, which smooths every edge. Why not a plotting crate: without the
//! system's fonts those need a font file to be shipped, and without the system's libraries their thick lines are not
//! smoothed; the dots of our own font, joined by strokes, are smooth at every size. Nothing here depends on the
//! machine: the same data give the same bytes.

mod area;
mod axes;
mod canvas;
mod chart;
mod font;
mod legend;
mod lettering;
mod sheet;
mod stroke;
mod ticks;
mod tracks;

pub use canvas::{Canvas, Colour, Frame, text_height, text_width};
pub use chart::{LineChart, Panel, Series, Shape, line_chart};
pub use stroke::Stroke;
pub use tracks::{Track, TrackPoint, plot_axes, plot_paths};

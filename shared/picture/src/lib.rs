//! Pictures for people: a canvas, line charts, and walked paths from above.
//!
//! - [`Canvas`]: whole pixels, for maps whose cells must stay exact.
//! - [`LineChart`] and [`line_chart`]: panels over one x axis, with lines and bands (memory over time, an error and
//!   its three sigma).
//! - [`plot_paths`] and [`plot_axes`]: tracks from above, and their x, y and z over time (Figures 8 and 9 of the paper).
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

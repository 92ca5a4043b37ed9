//! What all point cloud formats hold in common, and a reader for any of them.

mod reader;

pub use reader::{Kind, Reader};

/// One point of a cloud file.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CloudPoint {
    /// Metres, in the frame of the file.
    pub x: f32,
    /// Metres.
    pub y: f32,
    /// Metres.
    pub z: f32,
    /// Intensity or reflectivity in the file's own unit; 0 where the file has none.
    pub intensity: f32,
}

impl CloudPoint {
    /// Whether all coordinates are finite. Files of organised clouds hold NaN where a ray had no return.
    pub fn is_finite(&self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.z.is_finite()
    }
}

/// Whether a written cloud carries the intensity of its points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Intensity {
    /// Fields x, y, z and intensity.
    Kept,
    /// Fields x, y and z.
    Dropped,
}

/// What is taken off all coordinates before they become `f32`, metres. Coordinates of a map projection (some 500,000 and
/// 4,000,000) would otherwise keep no more than decimetres.
pub type Origin = [f64; 3];

/// One coordinate from its origin; exactly the value where the origin is 0.
pub(crate) fn relative(value: f64, origin: f64) -> f32 {
    (value - origin) as f32
}

/// The same of text: as `f32` straight away where the origin is 0, so that it is rounded once.
pub(crate) fn relative_word(word: &str, origin: f64) -> Option<f32> {
    if origin == 0.0 { word.parse().ok() } else { word.parse().ok().map(|value| relative(value, origin)) }
}

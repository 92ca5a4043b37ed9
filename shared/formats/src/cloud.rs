//! What all point cloud formats hold in common.

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

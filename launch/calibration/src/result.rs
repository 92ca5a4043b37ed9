//! What a calibration says.

use evac_stage::Rig;
use serde::Serialize;

use crate::correction::Correction;

/// What can be calibrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// The offset between the clocks.
    Time,
    /// The rotation between LiDAR and IMU.
    Rotation,
    /// The gyroscope's scale.
    Scale,
}

impl Quantity {
    /// All of them, in the order of the tables.
    pub const ALL: [Self; 3] = [Self::Time, Self::Rotation, Self::Scale];

    /// Standard error above which the motion has shown too little: half of what users are promised (2 ms, 0.5 degrees), so that
    /// two standard errors stay within it; for the scale 0.3 %, the odometry's own expectation.
    pub fn largest_error(self) -> f64 {
        match self {
            Self::Time => 1.0,
            Self::Rotation => 0.25,
            Self::Scale => 0.3,
        }
    }
}

/// One number with its standard error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Estimate {
    /// What it belongs to.
    pub quantity: Quantity,
    /// Axis of the IMU, 0 to 2; none for the time.
    pub axis: Option<usize>,
    /// Milliseconds, degrees or percent.
    pub value: f64,
    /// In the same unit.
    pub standard_error: f64,
    /// What to do about a motion that has not shown it.
    pub warning: Option<String>,
}

impl Estimate {
    /// Milliseconds, degrees or percent.
    pub fn unit(&self) -> &'static str {
        match self.quantity {
            Quantity::Time => "ms",
            Quantity::Rotation => "deg",
            Quantity::Scale => "%",
        }
    }

    /// Name for tables: `time offset`, `rotation x`, `scale x`.
    pub fn name(&self) -> String {
        let axis = self.axis.and_then(|axis| ["x", "y", "z"].get(axis)).unwrap_or(&"");
        match self.quantity {
            Quantity::Time => "time offset".to_owned(),
            Quantity::Rotation => format!("rotation {axis}"),
            Quantity::Scale => format!("gyro scale {axis}"),
        }
    }
}

/// What was found, and from how much.
#[derive(Debug, Clone, Serialize)]
pub struct Calibration {
    /// The correction of what was given, by what the motion has shown; the rest stays as it was.
    #[serde(skip)]
    pub correction: Correction,
    /// The rig as it was given.
    pub given: Rig,
    /// The rig with the correction.
    pub rig: Rig,
    /// Every number as measured, with its standard error: the time offset, rotations, scales.
    pub estimates: Vec<Estimate>,
    /// Scans whose orientation was used.
    pub scans: usize,
    /// Scans in the walk.
    pub scans_in_all: usize,
    /// Stretches within which they were compared.
    pub stretches: usize,
    /// Passes over the walk.
    pub passes: u32,
    /// Whether the last pass changed nothing any more.
    pub settled: bool,
    /// Root mean square of the angular rate about the IMU's axes, degrees/s.
    pub rms_rate_deg_s: [f64; 3],
}

impl Calibration {
    /// What the motion has not shown.
    pub fn warnings(&self) -> impl Iterator<Item = (&Estimate, &str)> {
        self.estimates.iter().filter_map(|one| Some((one, one.warning.as_deref()?)))
    }
}

/// What makes an axis turn.
pub(crate) fn remedy(quantity: Quantity, axis: Option<usize>) -> String {
    let name = axis.and_then(|axis| ["x", "y", "z"].get(axis)).unwrap_or(&"");
    let others = match axis {
        Some(0) => "y or z",
        Some(1) => "x or z",
        _ => "x or y",
    };
    match quantity {
        Quantity::Time => {
            "the rig must turn at changing rates: swing it left and right, 30 degrees in half a second, \
                           ten times, in a room with walls in view"
                .to_owned()
        }
        Quantity::Rotation => format!(
            "the rig must turn about an axis other than the IMU's {name}: tilt it about {others} by 30 degrees to and fro, \
             ten times, in a room with walls in view"
        ),
        Quantity::Scale => format!(
            "the rig must turn about the IMU's {name}: by 90 degrees and back, five times, in a room with walls in view"
        ),
    }
}

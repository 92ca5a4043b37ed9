//! Whether the odometry says which directions a blank wall leaves open.

use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::Vector3;
use serde::Serialize;

use crate::{FrameResult, Trajectory};

/// A stretch of frames before a blank wall counts from this length on.
const SHORTEST: usize = 3;
/// A flagged direction may lie so far out of the wall's plane, degrees.
const TOLERANCE_DEG: f64 = 15.0;

/// What was said before blank walls.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Corners {
    /// Stretches of at least three frames in a row that see a blank wall.
    pub corners: usize,
    /// Of them those in which all directions that are certainly open are flagged in at least half of the frames, and a wrong one in none.
    pub flagged: usize,
    /// Frames in these stretches.
    pub frames: usize,
    /// Of them those in which so many directions are flagged, within the wall's plane.
    pub frames_flagged: usize,
    /// Of them those with a flagged direction more than 15 degrees out of the plane.
    pub frames_wrong: usize,
}

impl Corners {
    /// Looks through a run, from its first pose on.
    pub fn of(run: &Trajectory) -> Self {
        let mut all = Self::default();
        let stretches = run.tracked().chunk_by(|a, b| a.wall.is_some() == b.wall.is_some());
        for stretch in stretches.filter(|stretch| stretch.len() >= SHORTEST) {
            let said: Vec<_> = stretch.iter().filter_map(said).collect();
            let count = |wanted: Said| said.iter().filter(|said| **said == wanted).count();
            let (right, wrong) = (count(Said::InThePlane), count(Said::OutOfIt));
            all.corners += usize::from(!said.is_empty());
            all.flagged += usize::from(!said.is_empty() && wrong == 0 && 2 * right >= said.len());
            all.frames += said.len();
            all.frames_flagged += right;
            all.frames_wrong += wrong;
        }
        all
    }
}

#[derive(PartialEq, Eq)]
enum Said {
    TooLittle,
    InThePlane,
    OutOfIt,
}

/// What a frame before a blank wall says of its directions.
fn said(frame: &FrameResult) -> Option<Said> {
    let normal = map_from_lidar(&frame.pose).rotation * frame.wall?;
    let axes = frame.pose.degenerate_axes.iter().take(frame.pose.degenerate as usize);
    let limit = TOLERANCE_DEG.to_radians().sin();
    let out = axes.clone().any(|axis| Vector3::from(*axis).dot(&normal).abs() > limit);
    Some(match (axes.len(), out) {
        (_, true) => Said::OutOfIt,
        (count, false) if count < frame.open => Said::TooLittle,
        (_, false) => Said::InThePlane,
    })
}

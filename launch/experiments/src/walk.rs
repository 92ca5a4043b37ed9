//! A walk in memory.

use std::sync::Arc;

use evac_frames::{ImuSample, Point, ScanHeader};
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::Isometry3;
use evac_simulator::{Config, simulate};
use evac_stage::Rig;

use crate::ExperimentError;
use crate::join::{slice, stream};
use crate::view::{Surroundings, View};

/// One scan with all that belongs to it.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Header of the scan.
    pub header: ScanHeader,
    /// Its points as the sensor gave them; shared between a walk and its faulty copies where they do not differ.
    pub points: Arc<[Point]>,
    /// IMU samples as the run loop's join would hand them over, see [`evac_stage::ScanWithImu::imu`].
    pub imu: Vec<ImuSample>,
    /// True pose of the LiDAR at the frame's end; level, its origin is the source's.
    pub truth: Isometry3<f64>,
    /// What it sees of the building's true shape.
    pub view: View,
}

/// A walk with its truth.
#[derive(Debug, Clone)]
pub struct Walk {
    /// Name in tables.
    pub name: String,
    /// What the stages are told about the sensors' places: the truth, unless a fault has changed it.
    pub rig: Rig,
    /// Scans in order of time.
    pub frames: Vec<Frame>,
}

impl Walk {
    /// All IMU samples, each once, in order.
    pub fn imu(&self) -> Vec<ImuSample> {
        stream(&self.frames)
    }

    /// The same scans with other IMU samples (in order of time), cut up as the run loop's join would.
    #[must_use]
    pub fn with_imu(&self, imu: &[ImuSample]) -> Self {
        let mut walk = self.clone();
        slice(&mut walk.frames, imu);
        walk
    }

    /// Length of the true path, metres.
    pub fn path_m(&self) -> f64 {
        self.frames.windows(2).map(|pair| step(pair).norm()).sum()
    }

    /// Seconds from the first frame's start to the end of frame `index`.
    pub fn seconds(&self, index: usize) -> f64 {
        match (self.frames.first(), self.frames.get(index)) {
            (Some(first), Some(frame)) => {
                frame.header.frame.end_ns.saturating_sub(first.header.frame.start_ns) as f64 * 1e-9
            }
            _ => 0.0,
        }
    }

    /// True speed at the end of frame `index`, m/s; 0 at the first.
    pub fn speed(&self, index: usize) -> f64 {
        let pair = index.checked_sub(1).and_then(|before| self.frames.get(before..=index));
        let Some([a, b]) = pair else { return 0.0 };
        let seconds = b.header.frame.end_ns.saturating_sub(a.header.frame.end_ns) as f64 * 1e-9;
        (b.truth.translation.vector - a.truth.translation.vector).norm() / seconds.max(1e-3)
    }
}

fn step(pair: &[Frame]) -> evac_geometry::nalgebra::Vector3<f64> {
    match pair {
        [a, b] => b.truth.translation.vector - a.truth.translation.vector,
        _ => evac_geometry::nalgebra::Vector3::zeros(),
    }
}

/// A walk through one of the simulator's worlds.
///
/// # Errors
/// [`ExperimentError::Stage`] for a configuration that the simulator refuses.
pub fn simulated(name: &str, config: &Config, rig: &Rig) -> Result<Walk, ExperimentError> {
    let about = |cause| ExperimentError::Stage { about: name.to_owned(), cause };
    let frames = simulate(config, rig).map_err(about)?;
    let surroundings = Surroundings::new(config, rig).map_err(about)?;
    let frames = frames
        .map(|frame| Frame {
            view: surroundings.view(&frame.header.frame, &frame.points),
            header: frame.header,
            points: frame.points.into(),
            imu: frame.imu,
            truth: map_from_lidar(&frame.truth),
        })
        .collect();
    Ok(Walk { name: name.to_owned(), rig: *rig, frames })
}

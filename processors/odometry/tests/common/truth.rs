//! A room's frames through the odometry, and how far its poses are off.

use evac_frames::{PoseFrame, TrackingState};
use evac_geometry::map_from_lidar;
use evac_odometry::{Lio, LioConfig};
use evac_stage::{Counters, PoseOutput, Rig, Stage};

use super::Pipeline;
use super::room::Frame;

pub fn run(frames: &[Frame]) -> Pipeline {
    let mut pipeline = Pipeline::new(&Rig::default());
    for frame in frames {
        frame.feed(&mut pipeline);
    }
    pipeline
}

/// Errors of position (metres) and rotation (degrees) of a pose relative to the first that was tracked: the tilt that an
/// accelerometer's bias looks like at rest is the map's and stays.
pub fn error_at(poses: &[PoseFrame], frames: &[Frame], index: usize) -> (f64, f64) {
    let first = poses.iter().position(|pose| pose.state != TrackingState::Initialising as u32).unwrap();
    let estimated = map_from_lidar(&poses[first]).inverse() * map_from_lidar(&poses[index]);
    let difference = (frames[first].truth.inverse() * frames[index].truth).inverse() * estimated;
    (difference.translation.vector.norm(), difference.rotation.angle().to_degrees())
}

pub fn end_error(pipeline: &Pipeline, frames: &[Frame]) -> (f64, f64) {
    error_at(pipeline.trajectory(), frames, frames.len() - 1)
}

pub fn is_finite(pose: &PoseFrame) -> bool {
    let vectors =
        [pose.position, pose.imu_position, pose.velocity, pose.gyro_bias, pose.accel_bias, pose.gravity];
    vectors.iter().flatten().chain(&pose.orientation).chain(&pose.imu_orientation).all(|x| x.is_finite())
        && pose.covariance.iter().chain(pose.degenerate_axes.iter().flatten()).all(|x| x.is_finite())
        && pose.quality.is_finite()
}

/// Poses of scans that nobody has deskewed.
pub fn odometry_alone(frames: &[Frame]) -> (Vec<PoseFrame>, Counters, Lio) {
    let mut lio = Lio::new(LioConfig::default(), &Rig::default()).unwrap();
    let (mut output, mut counters) = (PoseOutput::default(), Counters::default());
    for frame in frames {
        lio.process(frame.input(), &mut output, &mut counters).unwrap();
    }
    (output.memory, counters, lio)
}

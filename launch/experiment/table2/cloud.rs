//! A station-like cloud as a Mid-40 gives it: a simulated walk's shots with their true poses.

use evac_formats::cloud::CloudPoint;
use evac_geometry::nalgebra::Point3;
use evac_simulator::{Config, SHOT_NS, WorldKind, simulate};
use evac_stage::{Rig, StageError};

/// Points of the paper's cloud.
const POINTS: usize = 990_768;
/// Every so many frames are taken, so that the points are of the whole walk.
const STRIDE: usize = 4;

/// The paper's number of points of a walk through the simulator's station hall, map frame.
pub(super) fn of_walk(seed: u64) -> Result<Vec<CloudPoint>, StageError> {
    let config = Config { world: WorldKind::Hall, seed, ..Config::default() };
    let frames = simulate(&config, &Rig::default())?;
    let walk = frames.walk().clone();
    let mut points = Vec::with_capacity(POINTS);
    for frame in frames.step_by(STRIDE) {
        let returns = frame.points.iter().enumerate().filter(|(_, point)| point.is_return());
        for (shot, point) in returns.take(POINTS - points.len()) {
            let time_ns = frame.header.frame.start_ns + shot as i64 * SHOT_NS;
            let place = walk.map_from_lidar(time_ns) * Point3::new(point.x, point.y, point.z).cast::<f64>();
            let [x, y, z] = [place.x, place.y, place.z].map(|axis| axis as f32);
            points.push(CloudPoint { x, y, z, intensity: 0.0 });
        }
    }
    Ok(points)
}

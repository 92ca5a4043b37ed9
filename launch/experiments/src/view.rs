//! What the surroundings show of a scan's position by their true shape, whatever an odometry makes of it.

use evac_frames::{FrameHeader, Point};
use evac_geometry::nalgebra::{Matrix3, Vector3};
use evac_simulator::{Config, SHOT_NS, Walk, direction};
use evac_stage::{Rig, StageError};

/// Range noise of the Mid-40, metres.
const RANGE_NOISE_M: f64 = 0.02;
/// What else puts a point beside its surface (direction of the beam, time), metres.
const POINT_FLOOR_M: f64 = 0.005;
/// Information on a direction below this leaves it open, 1/m^2: 3 mm if all ranges of a scan were independent, which they are not, and
/// all that is seen were known. One point in 225 that sees a surface across it would show it so well.
const OPEN: f64 = 1.0 / (0.003 * 0.003);
/// One shot in so many is looked at, and one in so many to see whether that is worth while.
const STRIDE: usize = 10;
const ROUGH_STRIDE: usize = 100;
/// Turn between a shot and the two beside it that tell the normal of the surface, rad: so narrow that next to none lie across an edge.
const BESIDE: f64 = 1e-4;
/// A return farther from the building than this is a person's or a stray one, metres.
const BUILDING_M: f64 = 0.15;
/// Farther than the Mid-40 sees, metres.
const MAX_RANGE_M: f64 = 300.0;

/// What a frame sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum View {
    /// Nobody knows.
    Unknown,
    /// At least two directions of its position show.
    Varied,
    /// A wall that leaves the two directions along it open, by its normal in the LiDAR frame at the frame's end.
    BlankWall(Vector3<f64>),
}

/// The building of a simulated walk, with smooth walls and without people.
#[derive(Debug)]
pub(crate) struct Surroundings {
    walk: Walk,
}

impl Surroundings {
    /// # Errors
    /// [`StageError`] for a configuration that the simulator refuses.
    pub(crate) fn new(config: &Config, rig: &Rig) -> Result<Self, StageError> {
        Ok(Self { walk: Walk::new(&Config { roughness_m: Some(0.0), ..config.clone() }, rig)? })
    }

    /// What the scan `points`, all shots of a frame, shows.
    pub(crate) fn view(&self, frame: &FrameHeader, points: &[Point]) -> View {
        // A few shots tell that most frames see no blank wall.
        self.blank_wall(frame, points, ROUGH_STRIDE)
            .and_then(|_| self.blank_wall(frame, points, STRIDE))
            .map_or(View::Varied, View::BlankWall)
    }

    /// Normal of the blank wall that one shot in `stride` shows.
    fn blank_wall(&self, frame: &FrameHeader, points: &[Point], stride: usize) -> Option<Vector3<f64>> {
        let eigen = self.information(frame, points, stride).symmetric_eigen();
        // Where a shot stands for many, two of them are no proof.
        let least = OPEN.max(2.0 * stride as f64 / RANGE_NOISE_M.powi(2));
        let open = eigen.eigenvalues.iter().filter(|value| **value < least).count();
        (open == 2).then(|| eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned())
    }

    /// Information of a scan on its own position if the building is known, 1/m^2, LiDAR frame at the frame's end: each range tells how far
    /// its surface is along the normal `n`, so the sum of `n n^T / variance`.
    fn information(&self, frame: &FrameHeader, points: &[Point], stride: usize) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        for (index, point) in points.iter().enumerate().step_by(stride).filter(|(_, p)| p.is_return()) {
            let time_ns = frame.start_ns + index as i64 * SHOT_NS;
            let beam = direction(frame.seq * points.len() as u64 + index as u64);
            let up = beam.cross(&Vector3::y()).normalize() * BESIDE;
            let beams = [beam, (beam + up).normalize(), (beam + up.cross(&beam)).normalize()];
            let [Some(at), Some(above), Some(beside)] =
                beams.map(|beam| self.walk.cast(time_ns, &beam, MAX_RANGE_M))
            else {
                continue;
            };
            let way = at.coords - self.walk.map_from_lidar(time_ns).translation.vector;
            let range = Vector3::new(point.x, point.y, point.z).norm();
            if (way.norm() - f64::from(range)).abs() > BUILDING_M {
                continue;
            }
            let Some(normal) = (above - at).cross(&(beside - at)).try_normalize(0.0) else { continue };
            let incidence = normal.dot(&way.normalize());
            let variance = (RANGE_NOISE_M * incidence).powi(2) + POINT_FLOOR_M.powi(2);
            sum += normal * normal.transpose() * (stride as f64 / variance);
        }
        let rotation = self.walk.map_from_lidar(frame.end_ns).rotation.to_rotation_matrix();
        rotation.matrix().transpose() * sum * rotation.matrix()
    }
}

#[cfg(test)]
mod tests {
    use evac_simulator::WorldKind;

    use super::*;
    use crate::simulated;

    #[test]
    fn before_the_end_of_a_corridor_its_wall_is_blank_and_along_the_corridor_the_view_is_not() {
        let config =
            Config { world: WorldKind::Corridor, seed: 3, duration_s: Some(22.0), ..Config::default() };
        let walk = simulated("corridor", &config, &Rig::default()).unwrap();
        assert!(walk.frames.iter().take(20).all(|frame| frame.view == View::Varied));
        let walls: Vec<_> = (walk.frames.iter())
            .filter_map(|frame| match frame.view {
                View::BlankWall(normal) => Some(frame.truth.rotation * normal),
                _ => None,
            })
            .collect();
        assert!(walls.len() >= 3, "{}", walls.len());
        // It stands upright, and is the same wall in all of them.
        for normal in &walls {
            assert!(normal.z.abs() < 1e-6 && normal.cross(&walls[0]).norm() < 1e-6, "{normal}");
        }
    }
}

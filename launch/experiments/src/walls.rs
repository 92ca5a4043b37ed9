//! Whether a scan shows a blank wall and nothing else.

use evac_frames::Point;
use evac_geometry::nalgebra::{Matrix3, SymmetricEigen, Vector3};
use evac_simulator::Random;

/// Points looked at, evenly spread over the scan.
const SAMPLE: usize = 512;
/// Planes tried through three points each: one through a wall of 90 % is missed with a chance of (1 - 0.9^3)^32 = 1e-18.
const TRIALS: usize = 32;
/// Distance of a wall's points from its plane, metres: four times the Mid-40's range noise.
const THICKNESS_M: f64 = 0.08;
/// Distance that the range noise alone explains for most of them, metres: twice the Mid-40's.
const NOISE_M: f64 = 0.04;
/// Fits of the plane to all points within it.
const REFINEMENTS: usize = 4;
/// Share of the points on it from which on the wall is blank.
const BLANK: f64 = 0.9;

/// A wall that fills the view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// Its normal in the LiDAR frame.
    pub normal: Vector3<f64>,
    /// Share of the scan's points on it.
    pub share: f64,
}

/// The plane that holds at least 90 % of the scan's points, if there is one. The same for the same scan every time.
///
/// The plane is that of the wall with the most points, found within the range noise alone: from half a metre away an edge between
/// two walls fits into the thickness of a plane laid across it, and an edge is not blank.
pub fn blank_wall(points: &[Point]) -> Option<Wall> {
    let returns = || points.iter().filter(|point| point.is_finite() && point.is_return());
    let every = returns().count().div_ceil(SAMPLE).max(1);
    let sample: Vec<Vector3<f64>> = returns()
        .step_by(every)
        .map(|p| Vector3::new(f64::from(p.x), f64::from(p.y), f64::from(p.z)))
        .collect();
    let (mut mean, mut normal) = fullest(&sample)?;
    // The three points give the plane roughly, all of its points give it well.
    for _ in 0..REFINEMENTS {
        let on_it: Vec<_> =
            sample.iter().filter(|place| (*place - mean).dot(&normal).abs() <= NOISE_M).collect();
        mean = on_it.iter().copied().sum::<Vector3<f64>>() / on_it.len().max(1) as f64;
        let scatter: Matrix3<f64> =
            on_it.iter().map(|place| (*place - mean) * (*place - mean).transpose()).sum();
        let eigen = SymmetricEigen::new(scatter);
        normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    }
    let count = sample.iter().filter(|place| (*place - mean).dot(&normal).abs() <= THICKNESS_M).count();
    let share = count as f64 / sample.len().max(1) as f64;
    (share >= BLANK).then_some(Wall { normal, share })
}

/// A place and the normal of the plane through three points that has the most points within the range noise.
fn fullest(sample: &[Vector3<f64>]) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let mut random = Random::new(sample.len() as u64, 0);
    let mut best = (0, Vector3::zeros(), Vector3::zeros());
    for _ in 0..TRIALS {
        let mut any = || sample.get((random.uniform() * sample.len() as f64) as usize).copied();
        let (a, b, c) = (any()?, any()?, any()?);
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-6) else { continue };
        let count = sample.iter().filter(|place| (*place - a).dot(&normal).abs() <= NOISE_M).count();
        if count > best.0 {
            best = (count, a, normal);
        }
    }
    Some((best.1, best.2))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan(place: impl Fn(f64, f64) -> [f64; 3]) -> Vec<Point> {
        let mut random = Random::new(5, 1);
        (0..3000)
            .map(|_| {
                let [x, y, z] = place(2.0 * random.uniform() - 1.0, 2.0 * random.uniform() - 1.0);
                Point::new((x + 0.02 * random.normal()) as f32, y as f32, z as f32, 0, 0)
            })
            .collect()
    }

    #[test]
    fn a_wall_across_the_view_is_blank_and_its_normal_is_found() {
        let wall = blank_wall(&scan(|y, z| [3.0 + 0.2 * y, y, z])).unwrap();
        let across = Vector3::new(1.0, -0.2, 0.0).normalize();
        assert!(wall.normal.dot(&across).abs() > 0.5_f64.to_radians().cos(), "{:?}", wall.normal);
        assert!(wall.share > 0.99);
    }

    #[test]
    fn the_edge_between_two_walls_is_not_blank_from_half_a_metre_away() {
        // A quarter of the view is the other wall, which comes towards the sensor; all of it lies within 8 cm of a plane across.
        let edge = |y: f64, z: f64| {
            let (y, z) = (0.2 * y, 0.2 * z);
            if y > 0.1 { [0.6 - 1.8 * (y - 0.1), 0.1, z] } else { [0.6, y, z] }
        };
        assert_eq!(blank_wall(&scan(edge)), None);
        let wall = blank_wall(&scan(|y, z| [0.6, 0.2 * y, 0.2 * z])).unwrap();
        assert!(wall.normal.x.abs() > 2_f64.to_radians().cos(), "{:?}", wall.normal);
    }

    #[test]
    fn a_wall_with_a_door_jamb_in_a_fifth_of_the_view_is_not_blank() {
        assert_eq!(blank_wall(&scan(|y, z| [if y > 0.6 { 3.5 } else { 3.0 }, y, z])), None);
        assert_eq!(blank_wall(&[]), None);
    }
}

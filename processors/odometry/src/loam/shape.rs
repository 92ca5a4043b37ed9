//! Lines and planes through the nearest points of the map (paper, section III.A).

use evac_geometry::nalgebra::{Matrix3, Vector3};

use super::nearest::NEIGHBOURS;

/// The eigenvalue that stands out does so by this factor (paper: 3).
const DISTINCT: f64 = 3.0;
/// Least spread of a plane's points across their longest axis, metres (root of the sum of squares): on a line there are many
/// planes.
const LEAST_SPREAD: f64 = 0.15;
/// Farthest point from its line or plane, metres: where two surfaces share a voxel there is neither.
const MAX_OFFSET: f64 = 0.05;

/// A line or plane that a point is matched with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shape {
    /// A point on it.
    pub(crate) centre: Vector3<f64>,
    /// Direction of the line or normal of the plane, unit vector.
    pub(crate) axis: Vector3<f64>,
    pub(crate) is_line: bool,
}

impl Shape {
    /// The line through points that lie in one.
    pub(crate) fn line(points: &[Vector3<f64>; NEIGHBOURS]) -> Option<Self> {
        let (centre, values, vectors) = principal(points);
        let shape = Self { centre, axis: vectors[2], is_line: true };
        (values[2] > DISTINCT * values[1] && shape.holds(points)).then_some(shape)
    }

    /// The plane through points that lie in one and not on a line.
    pub(crate) fn plane(points: &[Vector3<f64>; NEIGHBOURS]) -> Option<Self> {
        let (centre, values, vectors) = principal(points);
        let shape = Self { centre, axis: vectors[0], is_line: false };
        let spread = values[1] > LEAST_SPREAD * LEAST_SPREAD;
        (DISTINCT * values[0] < values[1] && spread && shape.holds(points)).then_some(shape)
    }

    /// Distance of a point, never negative for a line, and the direction in which it grows.
    pub(crate) fn residual(&self, point: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let offset = point - self.centre;
        if self.is_line {
            let across = offset - self.axis * self.axis.dot(&offset);
            let distance = across.norm();
            return (distance, if distance > 1e-9 { across / distance } else { Vector3::zeros() });
        }
        (self.axis.dot(&offset), self.axis)
    }

    fn holds(&self, points: &[Vector3<f64>]) -> bool {
        points.iter().all(|point| self.residual(point).0.abs() < MAX_OFFSET)
    }
}

/// Mean, eigenvalues in rising order and their eigenvectors.
fn principal(points: &[Vector3<f64>; NEIGHBOURS]) -> (Vector3<f64>, [f64; 3], [Vector3<f64>; 3]) {
    let mean = points.iter().sum::<Vector3<f64>>() / NEIGHBOURS as f64;
    let mut scatter = Matrix3::zeros();
    for point in points {
        let d = point - mean;
        scatter += d * d.transpose();
    }
    let eigen = scatter.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    (mean, order.map(|i| eigen.eigenvalues[i]), order.map(|i| eigen.eigenvectors.column(i).into_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_along_an_edge_make_its_line_and_no_plane_is_taken_for_one() {
        let direction = Vector3::new(1.0, 2.0, -2.0) / 3.0;
        let points = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|t| Vector3::new(4.0, 0.0, 1.0) + direction * (0.2 * t));
        let line = Shape::line(&points).unwrap();
        assert!(line.axis.cross(&direction).norm() < 1e-9);
        let off = direction.cross(&Vector3::z()).normalize() * 0.07;
        let (distance, towards) = line.residual(&(points[1] + off));
        assert!((distance - 0.07).abs() < 1e-9 && (towards * 0.07 - off).norm() < 1e-9);
    }

    #[test]
    fn points_on_a_wall_make_its_plane_and_no_line() {
        let points = [[0.0, 0.0], [0.3, 0.0], [0.0, 0.3], [-0.3, 0.0], [0.0, -0.3]]
            .map(|[y, z]| Vector3::new(2.0 + 0.001 * (y + z), y, z));
        let plane = Shape::plane(&points).unwrap();
        assert!(plane.axis.x.abs() > 0.999 && Shape::line(&points).is_none());
        assert!((plane.residual(&Vector3::new(2.05, 0.1, 0.1)).0.abs() - 0.05).abs() < 1e-3);
    }

    #[test]
    fn points_along_one_line_are_no_plane() {
        let points = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|t| Vector3::new(0.3 * t, 0.01 * t * t, 0.0));
        assert!(Shape::plane(&points).is_none());
    }

    #[test]
    fn a_corner_of_two_walls_is_no_plane() {
        let on_floor = [[0.3, 0.0], [0.3, 0.3], [0.6, 0.0]].map(|[x, y]| Vector3::new(x, y, 0.0));
        let on_wall = [[0.0, 0.3], [0.3, 0.3]].map(|[y, z]| Vector3::new(0.0, y, z));
        let bent = [on_floor[0], on_floor[1], on_floor[2], on_wall[0], on_wall[1]];
        assert!(Shape::plane(&bent).is_none());
    }
}

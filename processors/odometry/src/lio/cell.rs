//! One voxel of the plane map: the running moments of its points and the plane through them (design section 5.4).

use evac_geometry::nalgebra::{Matrix3, Vector3};

/// Points before a plane is fitted.
const MIN_POINTS: u32 = 20;
/// A full cell takes no more points; freezing at 500 cost one hall walk decimetres.
const MAX_POINTS: u32 = 5000;
/// Points are refitted when they have grown by this factor.
const REFIT_GROWTH: f64 = 1.3;
/// Thickest plane (standard deviation along the normal), metres: thicker ones are people and mixed surfaces.
const MAX_THICKNESS: f64 = 0.025;
/// A planar cell refuses points farther off than so many of its thicknesses, at least 8 mm each.
const REFUSE_SIGMAS: f64 = 4.0;
const REFUSE_FLOOR: f64 = 0.008;

/// A fitted plane. Lengths in metres, map frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plane {
    /// Unit normal; its sign has no meaning.
    pub(crate) normal: Vector3<f64>,
    /// In-plane axis of the smaller spread; the other is `normal x axis`.
    pub(crate) axis: Vector3<f64>,
    /// Centroid of the points.
    pub(crate) centroid: Vector3<f64>,
    /// Variances along normal, `axis` and `normal x axis`.
    pub(crate) variances: [f64; 3],
    /// Points in the fit.
    pub(crate) points: f64,
}

impl Plane {
    /// Signed distance of a point.
    pub(crate) fn distance(&self, point: &Vector3<f64>) -> f64 {
        self.normal.dot(&(point - self.centroid))
    }

    /// Leverage of a point: 1 at the centroid, growing with the distance from it in units of the plane's spread.
    /// The plane's own height error there has the variance `variances[0] / points * leverage`.
    pub(crate) fn leverage(&self, point: &Vector3<f64>) -> f64 {
        let d = point - self.centroid;
        let (du, dv) = (self.axis.dot(&d), self.normal.cross(&self.axis).dot(&d));
        let [_, u, v] = self.variances;
        1.0 + du * du / u + dv * dv / v
    }
}

/// A voxel of the map.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cell {
    pub(crate) key: u64,
    /// Frame that last added to it or matched it.
    pub(crate) last_used: u32,
    count: u32,
    fitted_at: u32,
    mean: Vector3<f64>,
    /// Sums of products of deviations: xx, xy, xz, yy, yz, zz.
    scatter: [f64; 6],
    plane: Option<Plane>,
    /// Uncertainty of the pose that it was first seen from.
    born: PoseVariance,
}

/// Variances of a pose: position along the map's axes (m^2) and rotation about any of them (rad^2).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct PoseVariance {
    pub(crate) position: [f32; 3],
    pub(crate) rotation: f32,
}

impl Cell {
    pub(crate) fn new(key: u64, frame: u32, born: PoseVariance) -> Self {
        Self {
            key,
            born,
            last_used: frame,
            count: 0,
            fitted_at: 0,
            mean: Vector3::zeros(),
            scatter: [0.0; 6],
            plane: None,
        }
    }

    /// The plane, if the points lie in one.
    pub(crate) fn plane(&self) -> Option<&Plane> {
        self.plane.as_ref()
    }

    /// Uncertainty of the pose that it was first seen from: nothing that is matched with it can be better.
    pub(crate) fn born(&self) -> &PoseVariance {
        &self.born
    }

    /// Adds a point (Welford); a planar cell refuses points off its plane, which live in finer levels.
    pub(crate) fn add(&mut self, point: &Vector3<f64>, edge: f64) {
        if self.count >= MAX_POINTS {
            return;
        }
        if let Some(plane) = &self.plane {
            let limit = REFUSE_SIGMAS * plane.variances[0].sqrt().max(REFUSE_FLOOR);
            if plane.distance(point).abs() > limit {
                return;
            }
        }
        self.count += 1;
        let n = f64::from(self.count);
        let before = point - self.mean;
        self.mean += before / n;
        let after = point - self.mean;
        for (sum, product) in self.scatter.iter_mut().zip([
            before.x * after.x,
            before.x * after.y,
            before.x * after.z,
            before.y * after.y,
            before.y * after.z,
            before.z * after.z,
        ]) {
            *sum += product;
        }
        if self.count >= MIN_POINTS && n >= f64::from(self.fitted_at) * REFIT_GROWTH {
            self.fit(edge);
        }
    }

    fn fit(&mut self, edge: f64) {
        self.fitted_at = self.count;
        let n = f64::from(self.count);
        let [xx, xy, xz, yy, yz, zz] = self.scatter.map(|sum| sum / n);
        let eigen = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz).symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let [l0, l1, l2] = order.map(|i| eigen.eigenvalues[i].max(0.0));
        let planar = l0.sqrt() < MAX_THICKNESS && l1 > 10.0 * l0 && l1.sqrt() > 0.08 * edge;
        self.plane = planar.then(|| Plane {
            normal: eigen.eigenvectors.column(order[0]).into_owned(),
            axis: eigen.eigenvectors.column(order[1]).into_owned(),
            centroid: self.mean,
            variances: [l0, l1, l2],
            points: n,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EDGE: f64 = 1.6;

    /// Points on a grid in the plane `z = slope * x`, alternately `thickness` above and below.
    fn sheet(slope: f64, thickness: f64) -> Cell {
        let mut cell = Cell::new(1, 0, PoseVariance::default());
        for i in 0..400 {
            let (x, y) = (f64::from(i % 20) * 0.07, f64::from(i / 20) * 0.07);
            let side = if (i + i / 20) % 2 == 0 { thickness } else { -thickness };
            cell.add(&Vector3::new(x, y, slope * x + side), EDGE);
        }
        cell
    }

    #[test]
    fn points_of_a_wall_make_a_plane_with_its_normal_and_thickness() {
        let cell = sheet(0.5, 0.01);
        let plane = cell.plane().unwrap();
        let normal = Vector3::new(-0.5, 0.0, 1.0).normalize();
        assert!(plane.normal.cross(&normal).norm() < 2e-3);
        assert!((plane.variances[0].sqrt() - 0.01 * normal.z).abs() < 1e-3);
        assert!((plane.leverage(&plane.centroid) - 1.0).abs() < 1e-9);
        assert!(plane.leverage(&(plane.centroid + Vector3::new(0.0, 5.0, 0.0))) > 100.0);
    }

    #[test]
    fn a_thick_cloud_is_no_plane() {
        assert!(sheet(0.0, 0.1).plane().is_none());
    }

    #[test]
    fn a_plane_refuses_points_of_somebody_who_walks_before_it() {
        let mut cell = sheet(0.0, 0.01);
        let before = cell;
        for i in 0..1000 {
            cell.add(&Vector3::new(0.5 + f64::from(i) * 1e-4, 0.5, 0.3), EDGE);
        }
        assert_eq!(cell.count, before.count);
        assert_eq!(cell.plane(), before.plane());
    }
}

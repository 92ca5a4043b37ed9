//! One voxel of the plane map: the running moments of its points and the plane through them (design section 5.4).

use evac_geometry::nalgebra::{Matrix3, Vector3};

use super::drift::Piece;
use super::sections::SectionId;

/// Points before a plane is fitted.
const MIN_POINTS: u32 = 20;
/// A full cell takes no more points; freezing at 500 cost one hall walk decimetres.
const MAX_POINTS: u32 = 5000;
/// Points are refitted when they have grown by this factor.
const REFIT_GROWTH: f64 = 1.3;
/// Thickest plane (standard deviation along the normal), metres: thicker ones are people and mixed surfaces.
const MAX_THICKNESS: f64 = 0.07;
/// A plane must extend farther than the range noise spreads its points along the beams, variances by this factor: of a strip of wall that is
/// seen from near, narrower than the noise, the noise would make a plane across it. 1.5 and 2.5 were alike.
const NOISE_EXTENT: f64 = 2.5;
/// Variance of a point that the range noise does not explain (beam direction, time), m^2.
pub(crate) const POINT_FLOOR: f64 = 0.005 * 0.005;
/// So many sampling errors of the thickness above the sensor's own are taken for noise, not for roughness.
const ROUGH_SIGMAS: f64 = 2.0;
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
    /// Variance along the normal that the sensor does not explain, m^2: the surface is rough or uneven.
    pub(crate) roughness: f64,
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

    /// How far the normal may truly be turned towards each of the two axes, along that axis (standard deviations, rad). What makes a surface
    /// rough or uneven may as well be a step across the cell, to which the plane has fitted itself.
    pub(crate) fn tilts(&self) -> [Vector3<f64>; 2] {
        let [height, u, v] = self.variances;
        let height = height / self.points + self.roughness;
        [self.axis * (height / u).sqrt(), self.normal.cross(&self.axis) * (height / v).sqrt()]
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
    /// Sums of products of the unit beams: how much of the range noise lies along a normal.
    beams: [f32; 6],
    plane: Option<Plane>,
    /// Section of the map that it belongs to.
    pub(crate) section: SectionId,
    /// Piece of ground that it belongs to.
    pub(crate) piece: Piece,
}

impl Cell {
    pub(crate) fn new(key: u64, frame: u32, section: SectionId, piece: Piece) -> Self {
        Self {
            key,
            section,
            piece,
            last_used: frame,
            count: 0,
            fitted_at: 0,
            mean: Vector3::zeros(),
            scatter: [0.0; 6],
            beams: [0.0; 6],
            plane: None,
        }
    }

    /// Whether it holds enough points for a plane, if they lay in one.
    pub(crate) fn is_ripe(&self) -> bool {
        self.count >= MIN_POINTS
    }

    /// The plane, if the points lie in one.
    pub(crate) fn plane(&self) -> Option<&Plane> {
        self.plane.as_ref()
    }

    /// Adds a point (Welford) seen along the unit vector `beam`; a planar cell refuses points off its plane, which live in
    /// finer levels. `range_variance` is the sensor's, m^2.
    pub(crate) fn add(&mut self, point: &Vector3<f64>, beam: &Vector3<f64>, edge: f64, range_variance: f64) {
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
        for (sum, product) in self.scatter.iter_mut().zip(products(&before, &after)) {
            *sum += product;
        }
        for (sum, product) in self.beams.iter_mut().zip(products(beam, beam)) {
            *sum += product as f32;
        }
        if self.count >= MIN_POINTS && n >= f64::from(self.fitted_at) * REFIT_GROWTH {
            self.fit(edge, range_variance);
        }
    }

    fn fit(&mut self, edge: f64, range_variance: f64) {
        self.fitted_at = self.count;
        let n = f64::from(self.count);
        let eigen = symmetric(self.scatter.map(|sum| sum / n)).symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let [l0, l1, l2] = order.map(|i| eigen.eigenvalues[i].max(0.0));
        let [normal, axis, _] = order.map(|i| eigen.eigenvectors.column(i).into_owned());
        let beams = symmetric(self.beams.map(|sum| f64::from(sum) / n));
        let noise = |axis: &Vector3<f64>| range_variance * axis.dot(&(beams * axis)) + POINT_FLOOR;
        let planar = l0.sqrt() < MAX_THICKNESS
            && l1 > 10.0 * l0
            && l1.sqrt() > 0.08 * edge
            && l1 > NOISE_EXTENT * noise(&axis);
        self.plane = planar.then(|| {
            let sensor = noise(&normal);
            Plane {
                normal,
                axis,
                centroid: self.mean,
                variances: [l0, l1, l2],
                points: n,
                // The standard error of a variance of n normal samples is sqrt(2 / n) of it.
                roughness: (l0 - sensor * (1.0 + ROUGH_SIGMAS * (2.0 / n).sqrt())).max(0.0),
            }
        });
    }
}

/// Products xx, xy, xz, yy, yz, zz.
fn products(a: &Vector3<f64>, b: &Vector3<f64>) -> [f64; 6] {
    [a.x * b.x, a.x * b.y, a.x * b.z, a.y * b.y, a.y * b.z, a.z * b.z]
}

fn symmetric([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Matrix3<f64> {
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

#[cfg(test)]
mod tests {
    use super::*;

    const EDGE: f64 = 1.6;

    /// Points on a grid in the plane `z = slope * x`, alternately `thickness` above and below.
    fn sheet(slope: f64, thickness: f64) -> Cell {
        let mut cell = Cell::new(1, 0, 0, 0);
        for i in 0..400 {
            let (x, y) = (f64::from(i % 20) * 0.07, f64::from(i / 20) * 0.07);
            let side = if (i + i / 20) % 2 == 0 { thickness } else { -thickness };
            cell.add(&Vector3::new(x, y, slope * x + side), &Vector3::z(), EDGE, 4e-4);
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
    fn roughness_is_the_thickness_that_the_sensor_does_not_explain() {
        let smooth = sheet(0.0, 0.02).plane().unwrap().roughness;
        let rough = sheet(0.0, 0.05).plane().unwrap().roughness;
        assert_eq!(smooth, 0.0);
        assert!((rough.sqrt() - (0.05_f64.powi(2) - 0.02_f64.powi(2)).sqrt()).abs() < 5e-3, "{rough}");
    }

    #[test]
    fn a_thick_cloud_is_no_plane() {
        assert!(sheet(0.0, 0.1).plane().is_none());
    }

    #[test]
    fn the_noise_of_a_strip_of_wall_in_the_corner_of_a_cell_is_no_plane_across_it() {
        // 1 cm by 10 cm of a wall; its points stray by 2 cm along the beam, which makes a flat cloud of 4 cm by 10 cm.
        let strip = |width: f64, length: f64| {
            let mut cell = Cell::new(1, 0, 0, 0);
            for i in 0..300 {
                let (across, along) = ((f64::from(i) * 0.618).fract(), (f64::from(i) * 0.414).fract());
                let noise = 0.02 * if i % 2 == 0 { 1.0 } else { -1.0 };
                cell.add(&Vector3::new(noise, width * across, length * along), &Vector3::x(), 0.2, 4e-4);
            }
            cell.plane().copied()
        };
        assert_eq!(strip(0.01, 0.1), None);
        // Wide enough it is the wall.
        let wall = strip(0.25, 0.25).unwrap();
        assert!(wall.normal.x.abs() > 0.99, "{:?}", wall.normal);
    }

    #[test]
    fn a_plane_refuses_points_of_somebody_who_walks_before_it() {
        let mut cell = sheet(0.0, 0.01);
        let before = cell;
        for i in 0..1000 {
            cell.add(&Vector3::new(0.5 + f64::from(i) * 1e-4, 0.5, 0.3), &Vector3::z(), EDGE, 4e-4);
        }
        assert_eq!(cell.count, before.count);
        assert_eq!(cell.plane(), before.plane());
    }
}

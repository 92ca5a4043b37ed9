//! Sums over points, and the plane through them.

/// Zeroth to second moments of points.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    pub(super) n: f64,
    sum: [f64; 3],
    xx: f64,
    xy: f64,
    yy: f64,
    xz: f64,
    yz: f64,
    zz: f64,
}

impl Moments {
    pub(super) fn add(&mut self, [x, y, z]: [f64; 3]) {
        self.n += 1.0;
        self.sum = [self.sum[0] + x, self.sum[1] + y, self.sum[2] + z];
        self.xx += x * x;
        self.xy += x * y;
        self.yy += y * y;
        self.xz += x * z;
        self.yz += y * z;
        self.zz += z * z;
    }

    /// Adds `weight` times other moments.
    pub(super) fn merge(&mut self, other: &Self, weight: f64) {
        self.n += weight * other.n;
        for (sum, value) in self.sum.iter_mut().zip(other.sum) {
            *sum += weight * value;
        }
        self.xx += weight * other.xx;
        self.xy += weight * other.xy;
        self.yy += weight * other.yy;
        self.xz += weight * other.xz;
        self.yz += weight * other.yz;
        self.zz += weight * other.zz;
    }

    pub(super) fn mean(&self) -> [f64; 3] {
        self.sum.map(|sum| sum / self.n)
    }

    /// Widths of the points in the xy plane, narrow and wide, metres: of an evenly covered strip its true widths
    /// (deviation times the root of 12).
    pub(super) fn extents(&self) -> [f64; 2] {
        let [x, y, _] = self.mean();
        let (cxx, cxy, cyy) = (self.xx / self.n - x * x, self.xy / self.n - x * y, self.yy / self.n - y * y);
        let (middle, spread) = (0.5 * (cxx + cyy), (0.25 * (cxx - cyy).powi(2) + cxy * cxy).sqrt());
        [middle - spread, middle + spread].map(|eigenvalue| (12.0 * eigenvalue.max(0.0)).sqrt())
    }

    /// Least-squares plane z(x, y); `None` when the points do not spread over the xy plane.
    pub(super) fn plane(&self) -> Option<Plane> {
        let [x, y, z] = self.mean();
        let (cxx, cxy, cyy) = (self.xx / self.n - x * x, self.xy / self.n - x * y, self.yy / self.n - y * y);
        let (cxz, cyz, czz) = (self.xz / self.n - x * z, self.yz / self.n - y * z, self.zz / self.n - z * z);
        let det = cxx * cyy - cxy * cxy;
        let spread = cxx + cyy;
        if det.is_nan() || det <= 1e-9 * spread * spread {
            return None;
        }
        let slope = [(cyy * cxz - cxy * cyz) / det, (cxx * cyz - cxy * cxz) / det];
        let rms = (czz - slope[0] * cxz - slope[1] * cyz).max(0.0).sqrt();
        Some(Plane { centre: [x, y, z], slope, rms })
    }
}

/// z = centre.z + slope . (xy - centre.xy).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Plane {
    pub(super) centre: [f64; 3],
    pub(super) slope: [f64; 2],
    /// Deviation of the points from it in z, metres.
    pub(super) rms: f64,
}

impl Plane {
    pub(super) fn height(&self, x: f64, y: f64) -> f64 {
        self.centre[2] + self.slope[0] * (x - self.centre[0]) + self.slope[1] * (y - self.centre[1])
    }

    /// Tangent of the angle against the horizontal.
    pub(super) fn tilt(&self) -> f64 {
        (self.slope[0] * self.slope[0] + self.slope[1] * self.slope[1]).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tilted_rectangle_gives_back_its_slope_and_its_widths() {
        let mut moments = Moments::default();
        for i in 0..200 {
            for j in 0..100 {
                let (x, y) = (100.0 + 0.02 * f64::from(i), -50.0 + 0.01 * f64::from(j));
                moments.add([x, y, 3.0 + 0.1 * x - 0.2 * y]);
            }
        }
        let plane = moments.plane().unwrap();
        assert!((plane.slope[0] - 0.1).abs() < 1e-6 && (plane.slope[1] + 0.2).abs() < 1e-6);
        assert!((plane.height(0.0, 0.0) - 3.0).abs() < 1e-4 && plane.rms < 1e-4);
        let [narrow, wide] = moments.extents();
        assert!((narrow - 1.0).abs() < 1e-3 && (wide - 4.0).abs() < 1e-3);
    }

    #[test]
    fn points_on_a_line_or_at_one_place_have_no_plane() {
        let mut moments = Moments::default();
        moments.add([1.0, 2.0, 3.0]);
        assert!(moments.plane().is_none());
        moments.add([2.0, 4.0, 3.0]);
        moments.add([3.0, 6.0, 3.0]);
        assert!(moments.plane().is_none());
    }
}

//! Which directions the LiDAR does not observe (design section 5.7).

use evac_geometry::nalgebra::{Matrix3, Vector3};

/// Information on a direction below this, 1/m^2, says nothing about it: straights give 4e4 to 4e5, a blank wall
/// 0.02 to 100 sideways.
pub(crate) const OBSERVED: f64 = 1.5e3;

/// Directions in the map frame without information; `count` of them hold.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Degeneracy {
    pub(crate) axes: [Vector3<f64>; 3],
    pub(crate) count: usize,
}

impl Degeneracy {
    /// Eigenvectors of the position's information whose eigenvalue is too small, least observed first.
    pub(crate) fn of(information: &Matrix3<f64>) -> Self {
        let eigen = information.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let mut found = Self::default();
        for i in order {
            // NaN counts as not observed.
            let observed = eigen.eigenvalues[i] >= OBSERVED;
            if !observed {
                found.axes[found.count] = eigen.eigenvectors.column(i).into_owned();
                found.count += 1;
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_and_a_floor_leave_their_common_direction() {
        let (wall, floor) = (Vector3::x(), Vector3::z());
        let information = (wall * wall.transpose() + floor * floor.transpose()) * 1e5;
        let found = Degeneracy::of(&information);
        assert_eq!(found.count, 1);
        assert!(found.axes[0].cross(&Vector3::y()).norm() < 1e-9);
        assert_eq!(Degeneracy::of(&(Matrix3::identity() * 1e5)).count, 0);
        assert_eq!(Degeneracy::of(&Matrix3::zeros()).count, 3);
    }
}

//! Which directions the match observes: solution remapping after Zhang, Kaess and Singh 2016 ("On degeneracy of
//! optimization-based state estimation problems"), and what is said about it.

use evac_geometry::nalgebra::{Matrix3, Vector3};

use super::filter::{POSITION, PoseError, PoseInformation, ROTATION};

/// Information on a direction below this, 1/m^2, says nothing about it.
pub(crate) const OBSERVED: f64 = 1.5e3;
/// Nor does less than this share of the largest: normals of planes through few points wobble that much.
const OBSERVED_SHARE: f64 = 0.002;
/// Lever at which a rotation counts as a displacement, metres: from the middle of a corridor to its walls.
const LEVER: f64 = 1.0;

/// Directions of translation in the map frame without information; `count` of them hold.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Degeneracy {
    pub(crate) axes: [Vector3<f64>; 3],
    pub(crate) count: usize,
}

impl Degeneracy {
    /// All three directions.
    pub(crate) fn nothing_observed() -> Self {
        Self { axes: [Vector3::x(), Vector3::y(), Vector3::z()], count: 3 }
    }

    /// Directions of the position whose information is too small, least observed first; the rotation is taken as known.
    pub(crate) fn of(information: &PoseInformation) -> Self {
        Self::of_block(&information.fixed_view::<3, 3>(POSITION, POSITION).into_owned(), 1.0)
    }

    /// As above for a block of the information, at a lever of so many metres.
    fn of_block(block: &Matrix3<f64>, lever: f64) -> Self {
        let eigen = block.symmetric_eigen();
        let least = OBSERVED.max(OBSERVED_SHARE * eigen.eigenvalues.max()) * lever * lever;
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let mut found = Self::default();
        for i in order {
            // NaN counts as not observed.
            let observed = eigen.eigenvalues[i] >= least;
            if !observed {
                found.axes[found.count] = eigen.eigenvectors.column(i).into_owned();
                found.count += 1;
            }
        }
        found
    }

    /// The projection onto all other directions.
    fn complement(&self) -> Matrix3<f64> {
        self.axes
            .iter()
            .take(self.count)
            .fold(Matrix3::identity(), |rest, axis| rest - axis * axis.transpose())
    }
}

/// Takes everything that is said about badly observed directions out of the normal equations: there the prior holds.
///
/// Position and rotation each by themselves: an eigenvector of both would lend a little of a well observed rotation to an
/// unobserved position, which moves far more easily.
pub(crate) fn remap(information: &mut PoseInformation, vector: &mut PoseError) {
    let rotation = information.fixed_view::<3, 3>(ROTATION, ROTATION).into_owned();
    let mut kept = PoseInformation::zeros();
    kept.fixed_view_mut::<3, 3>(POSITION, POSITION).copy_from(&Degeneracy::of(information).complement());
    kept.fixed_view_mut::<3, 3>(ROTATION, ROTATION)
        .copy_from(&Degeneracy::of_block(&rotation, LEVER).complement());
    *information = kept * *information * kept;
    *vector = kept * *vector;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Information of points at `points` on surfaces with `normals`, a thousandth of it false in every direction.
    fn normal_equations(surfaces: &[(Vector3<f64>, Vector3<f64>)]) -> PoseInformation {
        let mut information = PoseInformation::identity() * 50.0;
        for (point, normal) in surfaces {
            let turn = point.cross(normal);
            let row = PoseError::from([normal.x, normal.y, normal.z, turn.x, turn.y, turn.z]);
            information += row * row.transpose() * 1e3;
        }
        information
    }

    #[test]
    fn in_a_corridor_without_an_end_nothing_is_said_about_the_way_along_it() {
        let mut surfaces = Vec::new();
        for i in 0..20 {
            let x = f64::from(i) * 0.5;
            surfaces.push((Vector3::new(x, 1.2, 0.3), Vector3::y()));
            surfaces.push((Vector3::new(x, -1.2, -0.2), Vector3::y()));
            surfaces.push((Vector3::new(x, 0.6, -1.2), Vector3::z()));
            surfaces.push((Vector3::new(x, -0.7, -1.2), Vector3::z()));
        }
        let mut information = normal_equations(&surfaces);
        let found = Degeneracy::of(&information);
        assert_eq!(found.count, 1);
        assert!(found.axes[0].cross(&Vector3::x()).norm() < 1e-3);
        let mut vector = information * PoseError::from([0.1, 0.01, 0.02, 0.0, 0.0, 0.01]);
        remap(&mut information, &mut vector);
        let along = PoseError::x();
        assert!((along.transpose() * information * along)[0] < 1.0 && vector[0].abs() < 1.0);
        // What is observed stays as it was.
        assert!(information[(1, 1)] > 3e4 && information[(5, 5)] > 1e5);
    }

    #[test]
    fn before_a_wall_its_distance_and_two_rotations_are_observed() {
        let mut surfaces = Vec::new();
        for i in 0..100 {
            let (y, z) = (f64::from(i % 10) * 0.1 - 0.45, f64::from(i / 10) * 0.1 - 0.45);
            surfaces.push((Vector3::new(1.5, y, z), Vector3::x()));
        }
        let mut information = normal_equations(&surfaces);
        assert_eq!(Degeneracy::of(&information).count, 2);
        let mut vector = PoseError::zeros();
        remap(&mut information, &mut vector);
        let kept = information.symmetric_eigen().eigenvalues.iter().filter(|value| **value > 1.0).count();
        assert_eq!(kept, 1 + 2);
    }

    #[test]
    fn without_matches_nothing_is_observed() {
        assert_eq!(Degeneracy::of(&PoseInformation::zeros()).count, 3);
        let (mut information, mut vector) = (PoseInformation::zeros(), PoseError::zeros());
        remap(&mut information, &mut vector);
        assert_eq!(information, PoseInformation::zeros());
    }
}

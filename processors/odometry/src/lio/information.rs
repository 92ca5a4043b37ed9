//! What the matches of a scan with planes say about the pose and the time offset: the normal equations of design section 5.6.

use evac_geometry::nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::degeneracy::{Degeneracy, OBSERVED};
use super::deskew::Twist;
use super::matching::{Match, pose_row};
use super::offset::PoseCovariance;
use super::plane_map::PlaneMap;
use super::sections::SectionId;
use super::state::{MEASURED, State, at};

/// Points of a frame are not independent (shared beam, time and surface errors): variance times this. Chosen
/// among 20, 30, 40 and 60 on the walks of series 0 (docs/odometry.md).
const INFLATION: f64 = 30.0;
/// Cauchy weight's scale in standard deviations, squared.
const CAUCHY_SQUARED: f64 = 4.0;
/// Common error of a plane that its fit does not show: the pose it was built from, metres.
const PLANE_FLOOR: f64 = 0.003;
/// The tilt of a rough plane is the same in scan after scan, as long as the plane is in view: what it makes of a direction counts so many
/// times. 1 was little different from it (docs/odometry.md).
const TILT_WEIGHT: f64 = 3.0;
/// Position less certain than this, metres (standard deviation), and rotation less certain than by the lever: see [`Information::cut`].
pub(crate) const DARK: f64 = 0.2;
/// Information on a direction of the position that may be false whatever its planes say, 1/m^2 a scan: a plane across an edge, a few points of
/// ground that was laid from a doubtful pose. While a pose is certain that does no harm, but one that has become unsure by a decimetre before a
/// wall would follow it. A scan along a straight shows a thousand times as much. 300 was as good, nothing was not.
pub(crate) const FALSE: f64 = 100.0;
/// Directions that a blank wall leaves open.
const BLANK: usize = 2;
/// Distance at which a rotation counts like a displacement, metres.
const LEVER: f64 = 5.0;

/// Information of a frame about the measured part of the error.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Information {
    pub(crate) matrix: Measured,
    pub(crate) vector: SVector<f64, MEASURED>,
    /// See [`Report::seen_information`](super::correction::Report::seen_information).
    pub(crate) seen: Matrix3<f64>,
    /// Sum of squared normalised residuals, and their number: of the present section, as how others lie is part of
    /// their residuals.
    pub(crate) squares: f64,
    pub(crate) here: usize,
    /// See [`Report::anchor`](super::correction::Report::anchor).
    pub(crate) anchor: Option<SectionId>,
}

pub(crate) type Measured = SMatrix<f64, MEASURED, MEASURED>;

/// Sums the matches with one section. Each cell's sum is scaled down by the error its points share: the plane's own.
///
/// What the tilts of planes may make of a direction is not believed of it: before an uneven wall two planes that differ by a few degrees
/// would show, frame after frame, the same little false motion along it. `always_false` may be false of a direction of the position whatever
/// the planes say, see [`FALSE`].
pub(crate) fn sum_of(
    map: &PlaneMap,
    matches: &[Match],
    state: &State,
    twist: &Twist,
    always_false: f64,
) -> Information {
    let rotation = state.rotation.to_rotation_matrix();
    let mut total = Information::default();
    let (mut turned, mut moved) = (Matrix3::zeros(), Matrix3::identity() * always_false);
    for cell in matches.chunk_by(|a, b| a.cell == b.cell) {
        let Some(plane) = cell.first().and_then(|matched| map.plane(matched.cell as usize)) else { continue };
        let normal = plane.normal;
        let offset = normal.dot(&plane.centroid);
        let normal_in_imu = rotation.inverse_transform_vector(&normal);
        let approach = normal.dot(&twist.velocity);
        let mut matrix = Measured::zeros();
        let mut vector = SVector::<f64, MEASURED>::zeros();
        let mut shared = 0.0;
        let (mut weights, mut centre) = (0.0, Vector3::zeros());
        for m in cell {
            let residual = normal.dot(&(rotation * m.point + state.position)) - offset;
            let squared = residual * residual / m.point_variance;
            let weight = 1.0 / (INFLATION * m.point_variance * (1.0 + squared / CAUCHY_SQUARED));
            let pose = pose_row(&normal_in_imu, &normal, &m.point);
            let by_offset = -(approach + normal_in_imu.dot(&twist.rate.cross(&m.point)));
            let h = SVector::<f64, MEASURED>::from([
                pose[0], pose[1], pose[2], pose[3], pose[4], pose[5], by_offset,
            ]);
            let weighted = h * weight;
            matrix += weighted * h.transpose();
            vector -= weighted * residual;
            weights += weight;
            centre += m.point * weight;
            shared += weight * (m.plane_variance + PLANE_FLOOR.powi(2));
            total.squares += squared;
        }
        let scale = 1.0 / (1.0 + shared);
        total.matrix += matrix * scale;
        total.vector += vector * scale;
        for tilt in plane.tilts() {
            let row = pose_row(&rotation.inverse_transform_vector(&tilt), &tilt, &(centre / weights));
            let (turn, shift) = (row.fixed_rows::<3>(at::ROTATION), row.fixed_rows::<3>(at::POSITION));
            turned += turn * turn.transpose() * (weights * scale * TILT_WEIGHT);
            moved += shift * shift.transpose() * (weights * scale * TILT_WEIGHT);
        }
    }
    total.doubted(&turned, &moved)
}

impl Information {
    /// Before a blank wall takes out the directions that are not observed, in position and in rotation: the little there is of them is
    /// false as often as not (a plane laid across an edge), and an uncertain pose would believe it. So it does with those that are not known: a wall
    /// whose normal is off by a fraction of a degree, and by another in the next scan, would seem to show the way along it.
    pub(crate) fn cut(&mut self, predicted: &PoseCovariance) {
        for (index, least, dark) in
            [(at::POSITION, OBSERVED, DARK), (at::ROTATION, OBSERVED * LEVER.powi(2), DARK / LEVER)]
        {
            let eigen = self.matrix.fixed_view::<3, 3>(index, index).into_owned().symmetric_eigen();
            if index == at::POSITION
                && eigen.eigenvalues.iter().filter(|value| **value < least).count() < BLANK
            {
                return;
            }
            let prior = predicted.fixed_view::<3, 3>(index, index).into_owned().symmetric_eigen();
            let open = eigen.eigenvectors.column_iter().zip(eigen.eigenvalues.iter());
            let unknown = prior.eigenvectors.column_iter().zip(prior.eigenvalues.iter());
            open.filter(|(_, value)| **value < least)
                .for_each(|(axis, _)| self.take_out(index, &axis.into_owned()));
            for (axis, _) in unknown.filter(|(_, variance)| **variance > dark * dark) {
                let block = self.matrix.fixed_view::<3, 3>(index, index).into_owned();
                if axis.dot(&(block * axis)) < least {
                    self.take_out(index, &axis.into_owned());
                }
            }
        }
    }

    /// Takes out all that is said of a direction of rotation or position.
    fn take_out(&mut self, index: usize, axis: &Vector3<f64>) {
        let mut direction = SVector::<f64, MEASURED>::zeros();
        direction.fixed_rows_mut::<3>(index).copy_from(axis);
        let kept = Measured::identity() - direction * direction.transpose();
        self.matrix = kept * self.matrix * kept;
        self.vector = kept * self.vector;
    }

    /// Takes each direction, of rotation and of position, for less by the share that is `turned` and `moved`: what may be false of it.
    fn doubted(self, turned: &Matrix3<f64>, moved: &Matrix3<f64>) -> Self {
        let mut kept = Measured::identity();
        for (index, doubt) in [(at::ROTATION, turned), (at::POSITION, moved)] {
            let eigen = self.matrix.fixed_view::<3, 3>(index, index).into_owned().symmetric_eigen();
            let mut block = Matrix3::zeros();
            for (axis, value) in eigen.eigenvectors.column_iter().zip(eigen.eigenvalues.iter()) {
                let value = value.max(0.0);
                let all = value + axis.dot(&(doubt * axis));
                block += axis * axis.transpose() * if all > 0.0 { value / all } else { 0.0 };
            }
            kept.fixed_view_mut::<3, 3>(index, index).copy_from(&block);
        }
        Self { matrix: kept * self.matrix * kept, vector: kept * self.vector, ..self }
    }

    pub(crate) fn observes_position(&self) -> bool {
        let position: Matrix3<f64> = self.matrix.fixed_view::<3, 3>(at::POSITION, at::POSITION).into_owned();
        Degeneracy::of(&position).count == 0
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.matrix += other.matrix;
        self.vector += other.vector;
    }

    /// Takes out what an unknown displacement of what is measured against may explain: `A - A (A + S^-1)^-1 A`, without S^-1.
    pub(crate) fn marginalised(&self, displacement: &PoseCovariance) -> Self {
        let mut covariance = Measured::zeros();
        covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(displacement);
        let lu = (Measured::identity() + self.matrix * covariance).lu();
        match (lu.solve(&self.matrix), lu.solve(&self.vector)) {
            (Some(matrix), Some(vector)) => {
                Self { matrix: (matrix + matrix.transpose()) / 2.0, vector, ..*self }
            }
            _ => Self::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_one_who_knows_only_the_distance_from_a_wall_no_error_of_its_normal_shows_the_way_along_it() {
        // Half a metre unsure along the wall, and the wall's normal is half a degree off.
        let mut predicted = PoseCovariance::identity() * 1e-6;
        predicted[(at::POSITION + 1, at::POSITION + 1)] = 0.25;
        let normal = Vector3::new(1.0, 0.009, 0.0).normalize();
        let mut wall = Information::default();
        let mut block = wall.matrix.fixed_view_mut::<3, 3>(at::POSITION, at::POSITION);
        block += normal * normal.transpose() * 1e5;
        wall.cut(&predicted);
        assert!(wall.matrix[(at::POSITION + 1, at::POSITION + 1)] < 1e-6);
        assert!(wall.matrix[(at::POSITION, at::POSITION)] > 0.99e5);
        // A second wall shows it.
        let mut corner = wall;
        corner.matrix[(at::POSITION + 1, at::POSITION + 1)] = 1e5;
        corner.cut(&predicted);
        assert!(corner.matrix[(at::POSITION + 1, at::POSITION + 1)] > 0.99e5);
    }
}

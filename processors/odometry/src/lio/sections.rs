//! Sections of the map, and how well each is known to lie to the one that the rig is in.
//!
//! A filter that takes its map for exact deceives itself at every corner. The wall beyond is laid from a pose that
//! has drifted by centimetres; matched with it a frame later the pose seems exact, and with it, through their correlation, velocity
//! and tilt: their true errors are locked in and go on to grow. So a part of the map that is begun from an uncertain pose
//! becomes a section of its own. From then on the filter's errors are counted relative to it, where the pose that it is
//! begun from is exact by definition and velocity and tilt keep what they are unsure of. How older sections lie to it is
//! uncertain by what the pose was. Where an older section is seen well again, errors are counted relative to
//! that one once more, and the pose comes back to it.

use evac_geometry::nalgebra::{Matrix3, SMatrix};
use evac_geometry::skew;

use super::state::{Covariance, State, add_variance, at};

/// Covariance of a pose error: rotation (IMU frame), position.
pub(crate) type PoseCovariance = SMatrix<f64, 6, 6>;

/// Sections that are told apart; beyond them the oldest but the first are merged.
pub(crate) const MAX_SECTIONS: usize = 64;

/// Number of a section, in the order in which they were begun.
pub(crate) type SectionId = u32;

/// All sections of a map.
#[derive(Debug)]
pub(crate) struct Sections {
    /// In the order of their numbers; the first is the map's origin.
    known: Vec<Section>,
    current: SectionId,
    next: SectionId,
}

#[derive(Debug, Clone, Copy)]
struct Section {
    id: SectionId,
    /// Uncertainty of its place relative to the current one: rotation about the map's axes, displacement of the map's origin.
    offset: PoseCovariance,
}

impl Sections {
    pub(crate) fn new() -> Self {
        let mut sections = Self { known: Vec::with_capacity(MAX_SECTIONS), current: 0, next: 0 };
        sections.clear();
        sections
    }

    /// One section, at the map's origin.
    pub(crate) fn clear(&mut self) {
        self.known.clear();
        self.known.push(Section { id: 0, offset: PoseCovariance::zeros() });
        (self.current, self.next) = (0, 1);
    }

    /// The section that errors are counted relative to and new cells belong to.
    pub(crate) fn current(&self) -> SectionId {
        self.current
    }

    /// Begins a section at the present pose, whose error is `covariance`'s.
    pub(crate) fn begin(&mut self, state: &State, covariance: &mut Covariance) {
        let pose = covariance.fixed_view::<6, 6>(0, 0).into_owned();
        self.add_to_all(&offset_from_pose(state, &pose));
        if self.known.len() == MAX_SECTIONS {
            // Cells of the one that goes are taken for its elder's, which is known less well.
            self.known.remove(1);
        }
        self.known.push(Section { id: self.next, offset: PoseCovariance::zeros() });
        self.current = self.next;
        self.next = self.next.saturating_add(1);
        relative_to_pose(state, covariance);
    }

    /// Makes all that is known so far uncertain by `offset` (rotation, displacement) against what will be laid now.
    pub(crate) fn doubt(&mut self, state: &State, covariance: &mut Covariance, pose: &PoseCovariance) {
        covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(pose);
        self.begin(state, covariance);
    }

    /// Counts errors relative to the older section `id` again.
    pub(crate) fn return_to(&mut self, id: SectionId, state: &State, covariance: &mut Covariance) {
        let offset = self.offset(id);
        let map = pose_by_offset(state);
        let mut change = SMatrix::<f64, { super::state::DIM }, 6>::zeros();
        change.fixed_view_mut::<6, 6>(0, 0).copy_from(&map);
        // Velocity and gravity turn along with the map.
        for (index, vector) in [(at::VELOCITY, &state.velocity), (at::GRAVITY, &state.gravity)] {
            change.fixed_view_mut::<3, 3>(index, 0).copy_from(&-skew(vector));
        }
        *covariance += change * offset * change.transpose();
        for section in &mut self.known {
            section.offset =
                if section.id == id { PoseCovariance::zeros() } else { between(&section.offset, &offset) };
        }
        self.current = id;
    }

    /// Uncertainty of the place of a section's cells as an error of the present pose.
    pub(crate) fn pose_covariance(&self, id: SectionId, state: &State) -> PoseCovariance {
        let map = pose_by_offset(state);
        map * self.offset(id) * map.transpose()
    }

    fn offset(&self, id: SectionId) -> PoseCovariance {
        let after = self.known.partition_point(|section| section.id <= id);
        after
            .checked_sub(1)
            .and_then(|index| self.known.get(index))
            .map_or_else(PoseCovariance::zeros, |s| s.offset)
    }

    fn add_to_all(&mut self, offset: &PoseCovariance) {
        self.known.iter_mut().for_each(|section| section.offset += offset);
    }
}

/// Uncertainty between two sections, each known relative to a third. Where one was reached by way of the other, it is what the
/// rest of the way added; where not, that difference is no covariance, and both ways together bound it.
fn between(a: &PoseCovariance, b: &PoseCovariance) -> PoseCovariance {
    let tiny = PoseCovariance::identity() * 1e-12;
    [a - b, b - a].into_iter().find(|rest| (rest + tiny).cholesky().is_some()).unwrap_or(a + b)
}

/// The pose error that a displacement of the map looks like from the present pose.
fn pose_by_offset(state: &State) -> PoseCovariance {
    let mut map = PoseCovariance::zeros();
    let imu_from_map = state.rotation.inverse().to_rotation_matrix();
    map.fixed_view_mut::<3, 3>(0, 0).copy_from(imu_from_map.matrix());
    map.fixed_view_mut::<3, 3>(3, 0).copy_from(&-skew(&state.position));
    map.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::identity());
    map
}

/// The inverse of [`pose_by_offset`], applied to a covariance.
fn offset_from_pose(state: &State, pose: &PoseCovariance) -> PoseCovariance {
    let rotation = state.rotation.to_rotation_matrix();
    let mut map = PoseCovariance::zeros();
    map.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation.matrix());
    map.fixed_view_mut::<3, 3>(3, 0).copy_from(&(skew(&state.position) * rotation.matrix()));
    map.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::identity());
    map * pose * map.transpose()
}

/// Counts all errors relative to the present pose, which is exact then.
fn relative_to_pose(state: &State, covariance: &mut Covariance) {
    let rotation = state.rotation.to_rotation_matrix();
    let mut change = Covariance::identity();
    for index in at::ROTATION..at::TIME_OFFSET {
        change[(index, index)] = 0.0;
    }
    for (index, vector) in [(at::VELOCITY, &state.velocity), (at::GRAVITY, &state.gravity)] {
        change.fixed_view_mut::<3, 3>(index, at::ROTATION).copy_from(&(skew(vector) * rotation.matrix()));
    }
    *covariance = change * *covariance * change.transpose();
    add_variance(covariance, at::ROTATION, EXACT_ROTATION.powi(2));
    add_variance(covariance, at::POSITION, EXACT_POSITION.powi(2));
}

/// What is exact by definition is so up to the blur of the scans that the section is laid from, rad and m.
const EXACT_ROTATION: f64 = 3e-4;
const EXACT_POSITION: f64 = 2e-3;

#[cfg(test)]
mod tests {
    use evac_geometry::exp_so3;
    use evac_geometry::nalgebra::Vector3;

    use super::super::state::add_variance;
    use super::*;

    fn state() -> State {
        State {
            rotation: exp_so3(&Vector3::new(0.1, -0.2, 1.3)),
            position: Vector3::new(5.0, -2.0, 1.0),
            velocity: Vector3::new(1.0, 0.2, 0.0),
            ..State::at_origin()
        }
    }

    #[test]
    fn the_pose_that_begins_a_section_is_exact_there_and_the_old_map_is_as_uncertain_as_it_was() {
        let (state, mut covariance) = (state(), Covariance::zeros());
        add_variance(&mut covariance, at::ROTATION, 1e-4);
        add_variance(&mut covariance, at::POSITION, 4e-4);
        add_variance(&mut covariance, at::VELOCITY, 1e-3);
        let before = covariance.fixed_view::<6, 6>(0, 0).into_owned();
        let mut sections = Sections::new();
        sections.begin(&state, &mut covariance);
        let exact = |i: usize| covariance[(i, i)].sqrt();
        assert!(exact(at::ROTATION) <= EXACT_ROTATION && exact(at::POSITION) <= EXACT_POSITION);
        assert!((sections.pose_covariance(0, &state) - before).norm() < 1e-12);
        assert_eq!(sections.pose_covariance(1, &state), PoseCovariance::zeros());
        // The velocity is turned by what the rotation is unsure of.
        let across = covariance[(at::VELOCITY + 2, at::VELOCITY + 2)];
        assert!((across - (1e-3 + 1e-4 * 1.04)).abs() < 1e-6, "{across}");
    }

    #[test]
    fn back_in_the_first_section_the_pose_is_as_uncertain_as_the_way_to_it() {
        let (state, mut covariance) = (state(), Covariance::zeros());
        let mut sections = Sections::new();
        for variance in [1e-4, 2e-4] {
            add_variance(&mut covariance, at::POSITION, variance);
            sections.begin(&state, &mut covariance);
        }
        sections.return_to(0, &state, &mut covariance);
        let blur = EXACT_POSITION.powi(2);
        assert!((covariance[(at::POSITION, at::POSITION)] - 3e-4).abs() < 3.0 * blur);
        let between = sections.pose_covariance(1, &state);
        assert!((between[(at::POSITION, at::POSITION)] - 1e-4).abs() < 3.0 * blur);
        assert!(sections.pose_covariance(0, &state).norm() < 1e-12);
    }

    #[test]
    fn more_sections_than_there_is_room_for_are_merged() {
        let (state, mut covariance) = (state(), Covariance::zeros());
        let mut sections = Sections::new();
        for _ in 0..200 {
            add_variance(&mut covariance, at::POSITION, 1e-4 - EXACT_POSITION.powi(2));
            sections.begin(&state, &mut covariance);
        }
        let along = |id| sections.pose_covariance(id, &state)[(at::POSITION, at::POSITION)];
        assert_eq!(sections.current(), 200);
        assert!((along(0) - 0.02).abs() < 1e-3 && along(5) == along(0) && along(199) < 2e-4);
    }
}

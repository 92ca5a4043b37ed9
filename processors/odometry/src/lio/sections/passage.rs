//! How the filter goes from one section to another.

use evac_geometry::nalgebra::{Isometry3, SMatrix};
use evac_geometry::skew;

use super::super::offset::{PoseCovariance, offset_by_pose, pose_by_offset};
use super::super::state::{CLONES, Covariance, DIM, State, add_variance, at};
use super::{MAX_SECTIONS, Section, SectionId, Sections};

/// What is exact by definition is so up to the blur of the scans that the section is laid from, rad and m.
const EXACT_ROTATION: f64 = 3e-4;
pub(super) const EXACT_POSITION: f64 = 2e-3;

impl Sections {
    /// Makes the ground in view uncertain by `offset` against all that was known up to now.
    pub(crate) fn displace(&self, offset: &PoseCovariance, state: &State, covariance: &mut Covariance) {
        let change = self.by_ground(state);
        *covariance += change * offset * change.transpose();
    }

    /// The error's derivative by a displacement of the ground that errors are counted against.
    fn by_ground(&self, state: &State) -> SMatrix<f64, DIM, 6> {
        let mut change = SMatrix::<f64, DIM, 6>::zeros();
        change.fixed_view_mut::<6, 6>(0, 0).copy_from(&-pose_by_offset(state));
        // Velocity and gravity turn along with the map.
        for (index, vector) in [(at::VELOCITY, &state.velocity), (at::GRAVITY, &state.gravity)] {
            change.fixed_view_mut::<3, 3>(index, 0).copy_from(&skew(vector));
        }
        for slot in (0..CLONES).filter(|slot| self.is_used(*slot)) {
            change.fixed_view_mut::<6, 6>(at::clone(slot), 0).copy_from(&-PoseCovariance::identity());
        }
        change
    }

    /// Begins a section at the present pose, whose error is `covariance`'s.
    pub(crate) fn begin(&mut self, state: &mut State, covariance: &mut Covariance) {
        if self.known.len() == MAX_SECTIONS {
            self.give_up_one(state, covariance);
        }
        let free = self.free_slot(state, covariance);
        self.known.iter_mut().filter(|section| section.slot.is_none()).for_each(|s| s.slot = Some(free));
        state.places[free] = Isometry3::identity();
        self.centres[free] = self.here;
        let by_pose = -offset_by_pose(state);
        let rotation = state.rotation.to_rotation_matrix();
        let mut change = Covariance::identity();
        for index in at::ROTATION..at::TIME_OFFSET {
            change[(index, index)] = 0.0;
        }
        for (index, vector) in [(at::VELOCITY, &state.velocity), (at::GRAVITY, &state.gravity)] {
            change.fixed_view_mut::<3, 3>(index, at::ROTATION).copy_from(&(skew(vector) * rotation.matrix()));
        }
        for slot in (0..CLONES).filter(|slot| self.is_used(*slot)) {
            change.fixed_view_mut::<6, 6>(at::clone(slot), at::ROTATION).copy_from(&by_pose);
        }
        *covariance = change * *covariance * change.transpose();
        add_variance(covariance, at::ROTATION, EXACT_ROTATION.powi(2));
        add_variance(covariance, at::POSITION, EXACT_POSITION.powi(2));
        let section = Section::here(self.next);
        self.known.push(section);
        self.here = section.as_centre();
        self.next = self.next.saturating_add(1);
    }

    /// Makes all that is known so far as uncertain against what will be laid now as `pose` says.
    pub(crate) fn doubt(&mut self, state: &mut State, covariance: &mut Covariance, pose: &PoseCovariance) {
        covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(pose);
        self.begin(state, covariance);
    }

    /// Counts errors relative to the older section `id` again, and goes over to its map frame.
    pub(crate) fn return_to(&mut self, id: SectionId, state: &mut State, covariance: &mut Covariance) {
        let section = self.section(id);
        let Section { slot: Some(slot), from_place, .. } = section else { return };
        // The place that it may share with others becomes its own.
        state.places[slot] *= from_place;
        let here = at::clone(slot);
        let mut own = covariance.fixed_view_mut::<6, 6>(here, here);
        own += self.apart(&section);
        for section in self.known.iter_mut().filter(|section| section.slot == Some(slot)) {
            section.from_place = from_place.inverse() * section.from_place;
        }
        let mut change = Covariance::identity();
        change.fixed_columns_mut::<6>(here).copy_from(&self.by_ground(state));
        let there_from_current = state.places[slot].inverse();
        for other in (0..CLONES).filter(|other| self.is_used(*other)) {
            state.places[other] = there_from_current * state.places[other];
        }
        // The section that is left takes the slot of the one that is returned to.
        state.places[slot] = there_from_current;
        *covariance = change * *covariance * change.transpose();
        *state = state.moved(&there_from_current);
        for section in &mut self.known {
            section.slot = match section.slot {
                None => Some(slot),
                Some(other) if other == slot => None,
                other => other,
            };
        }
        self.centres[slot] = self.here;
        self.here = section.as_centre();
    }
}

#[cfg(test)]
mod tests {
    use evac_geometry::log_so3;
    use evac_geometry::nalgebra::{Matrix3, Vector3};

    use super::super::ORIGIN;
    use super::super::tests::state;
    use super::*;

    /// The state and covariance after the error's part from `index` on has proved to be `value`.
    fn told(
        state: &State,
        covariance: &Covariance,
        index: usize,
        value: &Vector3<f64>,
    ) -> (State, Covariance) {
        let columns = covariance.fixed_columns::<3>(index).into_owned();
        let seen = columns.fixed_rows::<3>(index) + Matrix3::identity() * 1e-12;
        let gain = columns * seen.try_inverse().unwrap();
        (state.plus(&(gain * value)), covariance - gain * columns.transpose())
    }

    #[test]
    fn the_pose_that_begins_a_section_is_exact_there_and_the_old_map_is_as_uncertain_as_it_was() {
        let (mut state, mut covariance) = (state(), Covariance::zeros());
        add_variance(&mut covariance, at::ROTATION, 1e-4);
        add_variance(&mut covariance, at::POSITION, 4e-4);
        add_variance(&mut covariance, at::VELOCITY, 1e-3);
        let before = covariance.fixed_view::<6, 6>(0, 0).into_owned();
        let mut sections = Sections::new();
        sections.begin(&mut state, &mut covariance);
        let exact = |i: usize| covariance[(i, i)].sqrt();
        assert!(exact(at::ROTATION) <= EXACT_ROTATION && exact(at::POSITION) <= EXACT_POSITION);
        assert!((sections.pose_covariance(0, &state, &covariance) - before).norm() < 1e-12);
        assert_eq!(sections.pose_covariance(1, &state, &covariance), PoseCovariance::zeros());
        // The velocity is turned by what the rotation is unsure of.
        let across = covariance[(at::VELOCITY + 2, at::VELOCITY + 2)];
        assert!((across - (1e-3 + 1e-4 * 1.04)).abs() < 1e-6, "{across}");
    }

    #[test]
    fn back_in_the_first_section_the_pose_is_as_uncertain_as_the_way_to_it() {
        let (mut state, mut covariance) = (state(), Covariance::zeros());
        let mut sections = Sections::new();
        for variance in [1e-4, 2e-4] {
            add_variance(&mut covariance, at::POSITION, variance);
            sections.begin(&mut state, &mut covariance);
        }
        sections.return_to(0, &mut state, &mut covariance);
        let blur = EXACT_POSITION.powi(2);
        assert!((covariance[(at::POSITION, at::POSITION)] - 3e-4).abs() < 3.0 * blur);
        let between = sections.pose_covariance(1, &state, &covariance);
        assert!((between[(at::POSITION, at::POSITION)] - 1e-4).abs() < 3.0 * blur);
        assert!(sections.pose_covariance(0, &state, &covariance).norm() < 1e-12);
    }

    #[test]
    fn each_turn_among_sections_that_share_a_place_costs_no_more_than_the_first() {
        let (mut state, mut covariance) = (state(), Covariance::zeros());
        let mut sections = Sections::new();
        for _ in 0..3 * CLONES {
            add_variance(&mut covariance, at::POSITION, 1e-4);
            sections.begin(&mut state, &mut covariance);
        }
        let last = sections.current();
        let turn = |sections: &mut Sections, state: &mut State, covariance: &mut Covariance| {
            for id in [ORIGIN, last, 3, 5, 1] {
                sections.return_to(id, state, covariance);
            }
            (0..=last).map(|id| sections.pose_covariance(id, state, covariance)[(3, 3)]).fold(0.0, f64::max)
        };
        let (turns, first) = (100, turn(&mut sections, &mut state, &mut covariance));
        let later = (0..turns).map(|_| turn(&mut sections, &mut state, &mut covariance)).fold(0.0, f64::max);
        assert!(first > 5e-4 && later < f64::from(turns) * first, "{first} {later}");
    }

    #[test]
    fn ground_that_lies_askew_turns_the_pose_and_gravity_and_velocity_with_it() {
        let (state, mut covariance) = (state(), Covariance::zeros());
        let mut offset = PoseCovariance::zeros();
        for axis in 0..3 {
            offset[(axis, axis)] = 2e-3_f64.powi(2);
        }
        Sections::new().displace(&offset, &state, &mut covariance);
        // The scan shows that the rig is turned against this ground by a tenth of a degree.
        let turn = Vector3::new(1e-3, -1e-3, 1e-3);
        let (corrected, _) = told(&state, &covariance, at::ROTATION, &turn);
        assert!((log_so3(&(state.rotation.inverse() * corrected.rotation)) - turn).norm() < 1e-5);
        let seen_by_the_imu = |state: &State, vector: &Vector3<f64>| state.rotation.inverse() * vector;
        for vector in [|state: &State| state.gravity, |state: &State| state.velocity] {
            let (before, after) = (vector(&state), vector(&corrected));
            let change = seen_by_the_imu(&corrected, &after) - seen_by_the_imu(&state, &before);
            assert!(change.norm() < 1e-4 * before.norm() && (after - before).norm() > 5e-4, "{change}");
        }
    }

    #[test]
    fn gravity_that_is_found_in_a_new_section_levels_the_published_pose() {
        let (mut state, mut covariance) = (state(), Covariance::zeros());
        add_variance(&mut covariance, at::ROTATION, 2e-3_f64.powi(2));
        add_variance(&mut covariance, at::GRAVITY, 1e-8);
        let mut sections = Sections::new();
        sections.begin(&mut state, &mut covariance);
        let tilt = Vector3::new(1e-3, -2e-3, 0.0);
        let (corrected, _) = told(&state, &covariance, at::GRAVITY, &-tilt.cross(&state.gravity));
        let published = sections.seen_from_origin(&corrected);
        let turned = log_so3(&(published.rotation * state.rotation.inverse()));
        assert!((turned - tilt).norm() < 2e-5, "{turned}");
        assert!(published.gravity.xy().norm() < 1e-4, "{}", published.gravity);
    }

    #[test]
    fn a_velocity_that_proves_wrong_after_a_blind_stretch_takes_the_way_behind_it_back() {
        let (mut state, mut covariance) = (state(), Covariance::zeros());
        // Two seconds with a velocity known to 5 cm/s.
        let (seconds, variance) = (2.0, 0.05_f64.powi(2));
        add_variance(&mut covariance, at::VELOCITY, variance);
        add_variance(&mut covariance, at::POSITION, variance * seconds * seconds);
        for axis in 0..3 {
            covariance[(at::VELOCITY + axis, at::POSITION + axis)] = variance * seconds;
            covariance[(at::POSITION + axis, at::VELOCITY + axis)] = variance * seconds;
        }
        let mut sections = Sections::new();
        sections.begin(&mut state, &mut covariance);
        // Room for no more places than the state has.
        for _ in 0..2 * CLONES {
            sections.begin(&mut state, &mut covariance);
        }
        let wrong = Vector3::new(-0.04, 0.02, 0.01);
        let (corrected, covariance) = told(&state, &covariance, at::VELOCITY, &wrong);
        assert!((corrected.position - state.position).norm() < 1e-9);
        let way = sections.seen_from_origin(&corrected).position - state.position;
        assert!((way - wrong * seconds).norm() < 1e-3, "{way}");
        let sigma = sections.origin_covariance(&corrected, &covariance)[(at::POSITION, at::POSITION)].sqrt();
        assert!(sigma < 0.01, "{sigma}");
    }
}

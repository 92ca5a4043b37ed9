//! Sections of the map, and how well each is known to lie to the one that the rig is in.
//!
//! A filter that takes its map for exact deceives itself at every corner. The wall beyond is laid from a pose that
//! has drifted by centimetres; matched with it a frame later the pose seems exact, and with it, through their correlation, velocity
//! and tilt: their true errors are locked in and go on to grow. So a part of the map that is begun from an uncertain pose
//! becomes a section of its own. From then on the filter's errors are counted relative to it, where the pose that it is
//! begun from is exact by definition and velocity and tilt keep what they are unsure of. How older sections lie to it is
//! uncertain by what the pose was. Where an older section is seen well again, errors are counted relative to
//! that one once more, and the pose comes back to it.
//!
//! The places of the first section and of the last few are part of the state (stochastic cloning, Roumeliotis and Burdick 2002): what made
//! the pose uncertain made velocity and tilt so too, and both are seen soon after the corner. Through their correlation the
//! section's place is corrected then: where the velocity proves to have been wrong by so much, so was the way behind the blind
//! stretch, and where gravity is not where the map has it, the section is tilted. The published pose is the one relative to the first
//! section. Of older sections the place is kept as it was known last.

use evac_geometry::nalgebra::{Isometry3, SMatrix, SVector, Vector3};
use evac_geometry::skew;

use super::drift::Drift;
use super::offset::{PoseCovariance, offset_by_pose, pose_by_offset};
use super::state::{CLONES, Covariance, DIM, State, add_variance, at};

/// Sections that are told apart, 100 kB; beyond them those that lie best to their elders are taken for these.
pub(crate) const MAX_SECTIONS: usize = 256;
/// How far off a turn of a section counts as a displacement, metres.
const LEVER: f64 = 10.0;

/// Number of a section, in the order in which they were begun.
pub(crate) type SectionId = u32;
/// The map's origin.
pub(crate) const ORIGIN: SectionId = 0;

/// All sections of a map.
#[derive(Debug)]
pub(crate) struct Sections {
    /// In the order of their numbers; the first is the map's origin.
    known: Vec<Section>,
    next: SectionId,
    /// The section whose place each clone holds exactly; the sections that share the clone lie around it.
    centres: [Centre; CLONES],
    /// The current section, which is the centre of those that share no clone with others but its own place.
    here: Centre,
    /// What new ground adds within sections.
    pub(crate) drift: Drift,
}

#[derive(Debug, Clone, Copy)]
struct Section {
    id: SectionId,
    /// The state's clone that says how it lies to the current section; nothing where it lies as that one does.
    slot: Option<usize>,
    /// How it lies to that place: exactly there if the place is its own.
    from_place: Isometry3<f64>,
    /// How uncertain it lies to the hub of those that share the place. The hub stays what it is, whichever of them is the
    /// centre: were distances counted from the centre, each return to another would add its distance to all, and of three in turn
    /// they would grow like Fibonacci's numbers.
    from_hub: PoseCovariance,
}

/// Of the sections that share a place the one whose own it is.
#[derive(Debug, Clone, Copy)]
struct Centre {
    id: SectionId,
    from_hub: PoseCovariance,
}

impl Section {
    fn here(id: SectionId) -> Self {
        Self { id, slot: None, from_place: Isometry3::identity(), from_hub: PoseCovariance::zeros() }
    }

    fn as_centre(&self) -> Centre {
        Centre { id: self.id, from_hub: self.from_hub }
    }
}

impl Sections {
    pub(crate) fn new() -> Self {
        let origin = Section::here(ORIGIN).as_centre();
        let mut sections = Self {
            known: Vec::with_capacity(MAX_SECTIONS),
            centres: [origin; CLONES],
            here: origin,
            next: 0,
            drift: Drift::new(),
        };
        sections.clear();
        sections
    }

    /// One section, at the map's origin.
    pub(crate) fn clear(&mut self) {
        self.known.clear();
        self.known.push(Section::here(ORIGIN));
        self.here = Section::here(ORIGIN).as_centre();
        self.next = 1;
        self.drift.clear();
    }

    /// The section that errors are counted relative to and new cells belong to.
    pub(crate) fn current(&self) -> SectionId {
        self.here.id
    }

    /// Whether a section's place is told from the current one's.
    pub(crate) fn is_left(&self, id: SectionId) -> bool {
        self.section(id).slot.is_some()
    }

    /// `current_from_section`.
    pub(crate) fn place(&self, id: SectionId, state: &State) -> Isometry3<f64> {
        let section = self.section(id);
        let place = section.slot.map_or_else(Isometry3::identity, |slot| state.places[slot]);
        place * section.from_place
    }

    /// Brings points from the current section's frame into those of others; neighbouring ones mostly fall into the same.
    pub(crate) fn to_frames(
        &self,
        state: &State,
    ) -> impl FnMut(SectionId, &Vector3<f64>) -> Vector3<f64> + use<'_> {
        let state = *state;
        let mut recent = (self.current(), Isometry3::identity());
        move |id, point| {
            if id != recent.0 {
                recent = (id, self.place(id, &state).inverse());
            }
            recent.1.rotation * point + recent.1.translation.vector
        }
    }

    /// Uncertainty of a section's place as an error of the present pose.
    pub(crate) fn pose_covariance(
        &self,
        id: SectionId,
        state: &State,
        covariance: &Covariance,
    ) -> PoseCovariance {
        let section = self.section(id);
        let offset = section.slot.map_or_else(PoseCovariance::zeros, |slot| block(covariance, slot, slot));
        let map = pose_by_offset(state);
        map * (offset + self.apart(&section)) * map.transpose()
    }

    /// The state's clone that holds a section's place, and how far apart from that it may be, as a pose error.
    pub(crate) fn clone_of(&self, id: SectionId, state: &State) -> Option<(usize, PoseCovariance)> {
        let section = self.section(id);
        let map = pose_by_offset(state);
        section.slot.map(|slot| (slot, map * self.apart(&section) * map.transpose()))
    }

    /// How uncertain a section lies to the centre of those that share its place.
    fn apart(&self, section: &Section) -> PoseCovariance {
        let centre = section.slot.map_or(&self.here, |slot| &self.centres[slot]);
        if centre.id == section.id { PoseCovariance::zeros() } else { section.from_hub + centre.from_hub }
    }

    /// The state in the frame of the map's origin, as far as is known by now.
    pub(crate) fn seen_from_origin(&self, state: &State) -> State {
        state.moved(&self.place(ORIGIN, state).inverse())
    }

    /// Covariance of the pose relative to the map's origin.
    pub(crate) fn origin_covariance(&self, state: &State, covariance: &Covariance) -> PoseCovariance {
        let map = pose_by_offset(state);
        self.covariance_by_places(state, covariance) + map * self.drift.of_view() * map.transpose()
    }

    /// Counts ground of which the share `unseen` of a scan sees nothing known; it is laid from the present pose.
    pub(crate) fn lay(&mut self, unseen: f64, state: &State, covariance: &Covariance) {
        let map = offset_by_pose(state);
        self.drift.lay(unseen, &(map * covariance.fixed_view::<6, 6>(0, 0) * map.transpose()));
    }

    /// The same without what has drifted within sections.
    fn covariance_by_places(&self, state: &State, covariance: &Covariance) -> PoseCovariance {
        let place = self.pose_covariance(ORIGIN, state, covariance);
        let pose = covariance.fixed_view::<6, 6>(0, 0) + place;
        let Some(slot) = self.section(ORIGIN).slot else { return pose };
        let cross = covariance.fixed_view::<6, 6>(0, at::clone(slot)) * pose_by_offset(state).transpose();
        pose - cross - cross.transpose()
    }

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

    /// Makes all that is known so far uncertain by `offset` (rotation, displacement) against what will be laid now.
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

    fn section(&self, id: SectionId) -> Section {
        let after = self.known.partition_point(|section| section.id <= id);
        self.known.get(after.saturating_sub(1)).copied().unwrap_or(Section::here(id))
    }

    fn is_used(&self, slot: usize) -> bool {
        self.known.iter().any(|section| section.slot == Some(slot))
    }

    /// Gives up the section that lies best to its elder, for which its cells are taken from then on. The current one stays.
    fn give_up_one(&mut self, state: &State, covariance: &Covariance) {
        let loss = |index: usize| {
            let (elder, section) = (&self.known[index - 1], &self.known[index]);
            let between = self.place(elder.id, state).inverse() * self.place(section.id, state);
            let variances = self.variances_between(elder, section, covariance);
            let turn = between.rotation.angle().powi(2) + variances.fixed_rows::<3>(0).sum();
            between.translation.vector.norm_squared()
                + variances.fixed_rows::<3>(3).sum()
                + turn * LEVER.powi(2)
        };
        let removable = (1..self.known.len()).filter(|index| self.known[*index].id != self.current());
        if let Some(index) = removable.min_by(|a, b| loss(*a).total_cmp(&loss(*b))) {
            self.known.remove(index);
        }
    }

    /// How uncertain a section lies to its elder, from which it was begun. Of those that share a place it is at best the
    /// difference of their distances from the hub, and as a rule that, since the way from one to the other led on from the hub.
    fn variances_between(
        &self,
        elder: &Section,
        section: &Section,
        covariance: &Covariance,
    ) -> SVector<f64, 6> {
        if elder.slot == section.slot {
            return (section.from_hub - elder.from_hub).diagonal().abs();
        }
        let places = slots_apart(elder.slot, section.slot, covariance);
        (places + self.apart(elder) + self.apart(section)).diagonal()
    }

    /// A clone that is free. If none is, the two places that are known best to each other become one: that of the
    /// older sections, whose distances from their hub stay what they are.
    fn free_slot(&mut self, state: &State, covariance: &mut Covariance) -> usize {
        let map = pose_by_offset(state);
        let eldest =
            |slot| self.known.iter().find(|section| section.slot == Some(slot)).map(|section| section.id);
        let mut closest: Option<(f64, usize, usize, PoseCovariance)> = None;
        for slot in 0..CLONES {
            if !self.is_used(slot) {
                set_zero(covariance, slot);
                return slot;
            }
            for other in (0..CLONES).filter(|other| self.is_used(*other) && eldest(*other) < eldest(slot)) {
                let apart = slots_apart(Some(slot), Some(other), covariance);
                let distance = (map * apart * map.transpose()).fixed_view::<3, 3>(3, 3).trace();
                if closest.as_ref().is_none_or(|(least, ..)| distance < *least) {
                    closest = Some((distance, slot, other, apart));
                }
            }
        }
        let Some((_, slot, other, apart)) = closest else { return CLONES - 1 };
        let other_from_slot = state.places[other].inverse() * state.places[slot];
        let centre = self.centres[slot];
        let hubs_apart = apart + centre.from_hub;
        for section in self.known.iter_mut().filter(|section| section.slot == Some(slot)) {
            section.from_hub = if section.id == centre.id { apart } else { hubs_apart + section.from_hub };
            section.slot = Some(other);
            section.from_place = other_from_slot * section.from_place;
        }
        set_zero(covariance, slot);
        slot
    }
}

/// Covariance between two places.
fn block(covariance: &Covariance, a: usize, b: usize) -> PoseCovariance {
    covariance.fixed_view::<6, 6>(at::clone(a), at::clone(b)).into_owned()
}

/// How uncertain two places lie to each other; none is the current section's own.
fn slots_apart(a: Option<usize>, b: Option<usize>, covariance: &Covariance) -> PoseCovariance {
    let own =
        |slot: Option<usize>| slot.map_or_else(PoseCovariance::zeros, |slot| block(covariance, slot, slot));
    let (Some(first), Some(second)) = (a, b) else { return own(a) + own(b) };
    let cross = block(covariance, first, second);
    own(a) + own(b) - cross - cross.transpose()
}

/// Takes a place for exact, whatever it was.
fn set_zero(covariance: &mut Covariance, slot: usize) {
    covariance.fixed_rows_mut::<6>(at::clone(slot)).fill(0.0);
    covariance.fixed_columns_mut::<6>(at::clone(slot)).fill(0.0);
}

/// What is exact by definition is so up to the blur of the scans that the section is laid from, rad and m.
const EXACT_ROTATION: f64 = 3e-4;
const EXACT_POSITION: f64 = 2e-3;

#[cfg(test)]
mod tests {
    use evac_geometry::nalgebra::{Matrix3, Point3, Vector3};
    use evac_geometry::{exp_so3, log_so3};

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
    fn of_more_sections_than_there_is_room_for_those_that_lie_best_to_their_elders_are_given_up() {
        let (mut state, mut covariance) = (state(), Covariance::zeros());
        let mut sections = Sections::new();
        let begun = 2 * MAX_SECTIONS as SectionId;
        for id in 1..=begun {
            // Each second one is begun a centimetre off, the others a decimetre.
            let variance = if id % 2 == 0 { 1e-4 } else { 1e-2 };
            add_variance(&mut covariance, at::POSITION, variance - EXACT_POSITION.powi(2));
            sections.begin(&mut state, &mut covariance);
        }
        assert_eq!((sections.current(), sections.known.len()), (begun, MAX_SECTIONS));
        let odd = sections.known.iter().filter(|section| section.id % 2 == 1).count();
        assert!(odd > MAX_SECTIONS * 9 / 10, "{odd}");
        let along = |id| sections.pose_covariance(id, &state, &covariance)[(at::POSITION, at::POSITION)];
        let way = f64::from(begun / 2) * (1e-4 + 1e-2);
        assert!((along(0) / way - 1.0).abs() < 0.05 && along(begun - 1) < 2e-2, "{}", along(0));
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
    fn a_point_is_brought_into_the_frame_of_the_section_whose_cell_it_falls_into() {
        let (mut state, mut covariance) = (state(), Covariance::zeros());
        add_variance(&mut covariance, at::POSITION, 1e-2);
        let mut sections = Sections::new();
        sections.begin(&mut state, &mut covariance);
        state.places[0] = Isometry3::new(Vector3::new(0.03, 0.0, -0.01), Vector3::new(0.0, 0.0, 0.01));
        let point = Vector3::new(4.0, 2.0, 1.0);
        let mut in_section = sections.to_frames(&state);
        assert_eq!(in_section(1, &point), point);
        assert!((state.places[0] * Point3::from(in_section(0, &point)) - Point3::from(point)).norm() < 1e-12);
    }

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
}

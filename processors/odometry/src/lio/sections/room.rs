//! Room for sections: the state has few clones and the table an end.

use evac_geometry::nalgebra::SVector;

use super::super::offset::{PoseCovariance, pose_by_offset};
use super::super::state::{CLONES, Covariance, State, at};
use super::{Section, Sections, block};

/// How far off a turn of a section counts as a displacement, metres.
const LEVER: f64 = 10.0;

impl Sections {
    /// Gives up the section that lies best to its elder, for which its cells are taken from then on. The current one stays.
    pub(super) fn give_up_one(&mut self, state: &State, covariance: &Covariance) {
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
    pub(super) fn free_slot(&mut self, state: &State, covariance: &mut Covariance) -> usize {
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

#[cfg(test)]
mod tests {
    use super::super::super::state::add_variance;
    use super::super::passage::EXACT_POSITION;
    use super::super::tests::state;
    use super::super::{MAX_SECTIONS, SectionId};
    use super::*;

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
}

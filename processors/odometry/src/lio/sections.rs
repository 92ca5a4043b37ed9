//! Sections of the map, and how well each is known to lie to the one that the rig is in.
//!
//! A filter that takes its map for exact deceives itself at every corner. The wall beyond is laid from a pose that
//! has drifted by centimetres; matched with it a frame later the pose seems exact, and with it, through their correlation, velocity
//! and tilt: their true errors are locked in and go on to grow. So a part of the map that is begun from an uncertain pose
//! becomes a section of its own. From then on the filter's errors are counted relative to it, where the pose that it is
//! begun from is exact by definition and velocity and tilt keep what they are unsure of. How older sections lie to it is
//! uncertain by what the pose was. Where an older section is seen well again, errors are counted relative to
//! that one once more, and the pose comes back to it ([`passage`]). Cells keep the frame of their section, and so do points that are added to them.
//!
//! The places of the first section and of the last few are part of the state (stochastic cloning, Roumeliotis and Burdick 2002): what made
//! the pose uncertain made velocity and tilt so too, and both are seen soon after the corner. Through their correlation the
//! section's place is corrected then: where the velocity proves to have been wrong by so much, so was the way behind the blind
//! stretch, and where gravity is not where the map has it, the section is tilted. The published pose is the one relative to the first
//! section. Of older sections the place is kept as it was known last.

mod passage;
mod room;

use evac_geometry::nalgebra::{Isometry3, Vector3};

use super::drift::Drift;
use super::offset::{PoseCovariance, offset_by_pose, pose_by_offset};
use super::state::{CLONES, Covariance, State, at};

/// Sections that are told apart, 100 kB; beyond them those that lie best to their elders are taken for these.
pub(crate) const MAX_SECTIONS: usize = 256;
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
    /// The current section, the centre of those that lie as it does.
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

    fn section(&self, id: SectionId) -> Section {
        let after = self.known.partition_point(|section| section.id <= id);
        self.known.get(after.saturating_sub(1)).copied().unwrap_or(Section::here(id))
    }

    fn is_used(&self, slot: usize) -> bool {
        self.known.iter().any(|section| section.slot == Some(slot))
    }
}

/// Covariance between two places.
fn block(covariance: &Covariance, a: usize, b: usize) -> PoseCovariance {
    covariance.fixed_view::<6, 6>(at::clone(a), at::clone(b)).into_owned()
}

#[cfg(test)]
mod tests {
    use evac_geometry::exp_so3;
    use evac_geometry::nalgebra::Point3;

    use super::super::state::add_variance;
    use super::*;

    pub(super) fn state() -> State {
        State {
            rotation: exp_so3(&Vector3::new(0.1, -0.2, 1.3)),
            position: Vector3::new(5.0, -2.0, 1.0),
            velocity: Vector3::new(1.0, 0.2, 0.0),
            ..State::at_origin()
        }
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
}

//! The iterated update (design section 5.6). Neither the prior covariance nor the information is ever inverted: a
//! direction that no plane observes gets no correction.

use evac_geometry::nalgebra::{Matrix3, SMatrix, SVector};

use super::deskew::Twist;
use super::information::{DARK, Information, sum_of};
use super::joint::{Joint, SEEN, seen_columns, seen_rows};
use super::matching::{Known, Match, Search, Selected, associate};
use super::offset::{PoseCovariance, pose_by_offset};
use super::sections::SectionId;
use super::state::{Covariance, Error, State, at, largest_sigma};

/// An older section must have one match in so many to be returned to.
const ANCHOR_SHARE: usize = 3;
/// The present section must have one match in so many for its residuals to count.
const RESIDUAL_SHARE: usize = 10;
/// A section's place is estimated along while it is known to this, metres (standard deviation). Beyond, a false plane that the wide gate
/// lets in would move the place once and for good.
const KNOWN_PLACE: f64 = 0.01;
/// Iterations after the last association.
const REFINEMENTS: usize = 2;

/// How the gate on residuals is widened.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gate {
    /// Range noise, metres.
    pub(crate) range_noise: f64,
    /// Standard deviation added in each association, metres, one association each: a wide one finds the way to the map
    /// after a loss, and what it let in wrongly goes out again with the narrower ones after it.
    pub(crate) floors: &'static [f64],
    /// A pose that is very uncertain does not believe what little a blank wall shows of the directions along it.
    pub(crate) doubts_walls: bool,
    /// Information on each direction of the position that may be false, 1/m^2, see [`super::information::FALSE`].
    pub(crate) always_false: f64,
}

/// What the match says about itself.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Report {
    /// Points that went into the match.
    pub(crate) selected: usize,
    /// Of these, points where much is mapped, and points with a plane to be compared with.
    pub(crate) known: usize,
    pub(crate) in_view: usize,
    /// Of the latter, points that passed the gate.
    pub(crate) used: usize,
    /// Root mean square of the normalised residuals.
    pub(crate) residual: f64,
    /// Normalised innovation squared of the pose correction, per degree of freedom; healthy: below 1.
    pub(crate) nis: f64,
    /// The oldest section of the map that is older than the present one and shows the whole position by itself.
    pub(crate) anchor: Option<SectionId>,
    /// Information on the position, 1/m^2, map frame.
    pub(crate) position_information: Matrix3<f64>,
    /// The same as if the place of every section were known: what the shape of the surroundings shows.
    pub(crate) seen_information: Matrix3<f64>,
}

impl Report {
    /// Share of the selected points that were used.
    pub(crate) fn quality(&self) -> f64 {
        self.used as f64 / self.selected.max(1) as f64
    }

    /// The report of a frame that the map is made of.
    pub(crate) fn full() -> Self {
        Self { selected: 1, known: 1, in_view: 1, used: 1, ..Self::default() }
    }
}

/// Corrects state and covariance by the match of `selected` with what is known. `twist` is the motion in the middle of the scan,
/// end, which together with the velocity says how a time offset shows.
pub(crate) fn correct(
    known: &Known<'_>,
    selected: &[Selected],
    state: &mut State,
    covariance: &mut Covariance,
    twist: &Twist,
    gate: &Gate,
    matches: &mut Vec<Match>,
) -> Report {
    let prior = *state;
    let p_columns = seen_columns(covariance);
    let p_seen = seen_rows(&p_columns);
    let mut report = Report { selected: selected.len(), ..Report::default() };
    let predicted: PoseCovariance = p_seen.fixed_view::<6, 6>(0, 0).into_owned();
    let is_dark = gate.doubts_walls && largest_sigma(&predicted, at::POSITION) > DARK;
    let mut d = Error::zeros();
    let mut last = None;
    for iteration in 0..gate.floors.len() + REFINEMENTS {
        let here = prior.plus(&d);
        if let Some(floor) = gate.floors.get(iteration) {
            let search = Search {
                predicted: &predicted,
                covariance,
                first: iteration == 0,
                range_noise: gate.range_noise,
                gate_floor: *floor,
            };
            let view = associate(known, selected, &here, &search, matches);
            (report.known, report.in_view) = (view.known, view.compared);
        }
        let (mut information, mut joint) =
            accumulate(known, matches, &here, covariance, twist, gate.always_false);
        if is_dark {
            information.cut(&predicted);
            // What was cut must not be laid to the sections' places either.
            joint = Joint::default();
            joint.add(&information);
        }
        report.anchor = information.anchor;
        report.used = matches.len();
        // A handful of points says nothing about how well the whole fits.
        let says_much = information.here * RESIDUAL_SHARE >= matches.len();
        report.residual =
            if says_much { (information.squares / information.here.max(1) as f64).sqrt() } else { 0.0 };
        report.position_information =
            information.matrix.fixed_view::<3, 3>(at::POSITION, at::POSITION).into_owned();
        report.seen_information = information.seen;
        let lu = (SMatrix::<f64, SEEN, SEEN>::identity() + joint.matrix * p_seen).lu();
        // Residuals are not evaluated anew with the time offset: its linearisation point stays at zero.
        let mut d_seen = seen_rows(&d);
        d_seen[at::TIME_OFFSET] = 0.0;
        let Some(y) = lu.solve(&(joint.vector + joint.matrix * d_seen)) else { break };
        d = p_columns * y;
        last = Some((lu, joint.matrix));
    }
    let Some(gain) = last.and_then(|(lu, matrix)| lu.solve(&matrix)) else { return report };
    report.nis = nis(&d, &predicted);
    *state = prior.plus(&d);
    *covariance -= p_columns * gain * p_columns.transpose();
    *covariance = (*covariance + covariance.transpose()) / 2.0;
    report
}

/// Sums the matches: each section's sum scaled down by the uncertainty of its place against the present one, and the same with the places
/// as unknowns where they are known well enough.
fn accumulate(
    known: &Known<'_>,
    matches: &[Match],
    state: &State,
    covariance: &Covariance,
    twist: &Twist,
    always_false: f64,
) -> (Information, Joint) {
    let sections = known.sections;
    let (mut total, mut joint) = (Information::default(), Joint::default());
    let by_offset = pose_by_offset(state);
    for section in matches.chunk_by(|a, b| a.section == b.section) {
        let Some(id) = section.first().map(|matched| matched.section) else { continue };
        let there = state.moved(&sections.place(id, state).inverse());
        let sum = sum_of(known.map, section, &there, twist, always_false);
        let is_anchor = sections.is_left(id) && id < sections.current() && sum.observes_position();
        if is_anchor && section.len() * ANCHOR_SHARE > matches.len() {
            total.anchor = total.anchor.or(Some(id));
        }
        total.seen += sum.matrix.fixed_view::<3, 3>(at::POSITION, at::POSITION);
        if id == sections.current() {
            total.squares += sum.squares;
            total.here += section.len();
            total.add(&sum);
            joint.add(&sum);
            continue;
        }
        let place = sections.pose_covariance(id, state, covariance);
        let alone = sum.marginalised(&place);
        total.add(&alone);
        match sections.clone_of(id, state) {
            Some((slot, apart)) if largest_sigma(&place, at::POSITION) < KNOWN_PLACE => {
                joint.add_displaced(&sum.marginalised(&apart), slot, &by_offset);
            }
            _ => joint.add(&alone),
        }
    }
    (total, joint)
}

/// Squared pose correction in units of its predicted covariance, per degree of freedom (design section 4).
fn nis(d: &Error, predicted: &PoseCovariance) -> f64 {
    let pose: SVector<f64, 6> = d.fixed_rows::<6>(0).into_owned();
    predicted.cholesky().map_or(0.0, |cholesky| pose.dot(&cholesky.solve(&pose)) / 6.0)
}

#[cfg(test)]
mod tests {
    use evac_geometry::nalgebra::{Isometry3, Vector3};

    use super::super::degeneracy::Degeneracy;
    use super::super::information::FALSE;
    use super::super::matching::select;
    use super::super::plane_map::PlaneMap;
    use super::super::sections::Sections;
    use super::super::state::add_variance;
    use super::*;

    /// A wall two metres ahead in a map, and every seventh point of it as seen from `shift` off the map's origin.
    fn wall(shift: Vector3<f64>) -> (PlaneMap, Vec<Selected>) {
        let mut map = PlaneMap::new(4096, 0.02);
        let mut selected = Vec::new();
        for i in 0..8000 {
            let noise = if (i / 90 + i) % 2 == 0 { 0.015 } else { -0.015 };
            let point =
                Vector3::new(2.0 + noise, f64::from(i % 90) * 0.01 - 0.45, f64::from(i / 90) * 0.01 - 0.45);
            map.insert(&point, &Vector3::x());
            if i % 7 == 0 {
                selected.push(select(&Isometry3::identity(), &(point - shift)));
            }
        }
        (map, selected)
    }

    fn matched(
        (map, selected): &(PlaneMap, Vec<Selected>),
        sections: &Sections,
        state: &mut State,
        covariance: &mut Covariance,
    ) -> Report {
        let gate = Gate { range_noise: 0.02, floors: &[0.0; 2], doubts_walls: true, always_false: FALSE };
        let known = Known { map, sections };
        correct(&known, selected, state, covariance, &Twist::default(), &gate, &mut Vec::new())
    }

    #[test]
    fn a_wall_of_an_older_section_shows_its_direction_though_its_place_is_uncertain() {
        let mut state = State::at_origin();
        let mut covariance = Covariance::zeros();
        add_variance(&mut covariance, at::POSITION, 0.01);
        let mut sections = Sections::new();
        sections.begin(&mut state, &mut covariance);
        let report = matched(&wall(Vector3::zeros()), &sections, &mut state, &mut covariance);
        assert_eq!(Degeneracy::of(&report.position_information).count, 3);
        let open = Degeneracy::of(&report.seen_information);
        assert_eq!(open.count, 2);
        assert!(open.axes[..2].iter().all(|axis| axis.x.abs() < 0.1), "{open:?}");
    }

    #[test]
    fn a_bush_that_is_mapped_shows_nothing_and_is_no_new_ground() {
        let (mut map, mut selected) = (PlaneMap::new(4096, 0.02), Vec::new());
        for i in 0..20_000 {
            let leaf = [0.754_877, 0.569_840, 0.618_034].map(|step| (f64::from(i) * step).fract());
            let point = Vector3::from(leaf) + Vector3::new(2.0, -0.5, -0.5);
            map.insert(&point, &Vector3::x());
            if i % 20 == 0 {
                selected.push(select(&Isometry3::identity(), &point));
            }
        }
        // One of ten looks at what nobody has seen yet.
        for i in 0..100 {
            let unseen = Vector3::new(5.0, f64::from(i) * 0.01, 0.0);
            selected.push(select(&Isometry3::identity(), &unseen));
        }
        let bush = (map, selected);
        let report = matched(&bush, &Sections::new(), &mut State::at_origin(), &mut Covariance::zeros());
        // Where a cell holds a slice of it only, that is as flat as a plane.
        assert!(report.in_view < 300, "{report:?}");
        assert_eq!(report.known, 1000);
    }

    #[test]
    fn a_wall_corrects_the_distance_from_it_and_nothing_along_it() {
        // Seen from 3 cm nearer than believed, and shifted sideways, which a wall does not show.
        let seen = wall(Vector3::new(0.03, 0.01, 0.02));
        let mut state = State::at_origin();
        let mut covariance = Covariance::zeros();
        add_variance(&mut covariance, at::ROTATION, 1e-8);
        add_variance(&mut covariance, at::POSITION, 1e-2);
        let report = matched(&seen, &Sections::new(), &mut state, &mut covariance);
        assert!(report.used > seen.1.len() / 2, "{report:?}");
        assert!((state.position.x - 0.03).abs() < 2e-3, "{:?}", state.position);
        assert!(state.position.yz().norm() < 1e-3, "{:?}", state.position);
        let sigma = |i: usize| covariance[(at::POSITION + i, at::POSITION + i)].sqrt();
        assert!(sigma(0) < 0.02 && sigma(1) > 0.09 && sigma(2) > 0.09);
    }

    #[test]
    fn before_a_rubble_wall_the_same_scan_again_and_again_moves_nobody_along_it() {
        // Stones of 8 cm that stand out by 6 cm or not: planes through some of them are tilted by degrees.
        let surface = |y: f64, z: f64| {
            let stone = (((y + 2.0) / 0.08) as u64) * 31 + (((z + 2.0) / 0.08) as u64) * 17;
            2.0 + 0.06 * f64::from(u32::from((stone * 2_654_435_761) >> 7 & 1 == 1))
        };
        let (mut map, mut selected) = (PlaneMap::new(4096, 0.02), Vec::new());
        for i in 0..8000 {
            let noise = if (i / 90 + i) % 2 == 0 { 0.015 } else { -0.015 };
            let (y, z) = (f64::from(i % 90) * 0.02 - 0.9, f64::from(i / 90) * 0.02 - 0.9);
            map.insert(&Vector3::new(surface(y, z) + noise, y, z), &Vector3::x());
            // The scan sees another part of it than the map was made of.
            if i % 3 == 0 && y > -0.2 && z > 0.0 {
                selected.push(select(&Isometry3::identity(), &Vector3::new(surface(y, z) + noise, y, z)));
            }
        }
        let seen = (map, selected);
        let mut state = State::at_origin();
        let mut covariance = Covariance::zeros();
        add_variance(&mut covariance, at::ROTATION, 1e-7);
        add_variance(&mut covariance, at::POSITION, 4e-4);
        for _ in 0..40 {
            matched(&seen, &Sections::new(), &mut state, &mut covariance);
        }
        assert!(state.position.yz().norm() < 0.001, "{:?}", state.position);
        let sigma = |i: usize| covariance[(at::POSITION + i, at::POSITION + i)].sqrt();
        assert!(sigma(1) > 0.015 && sigma(2) > 0.015, "{} {}", sigma(1), sigma(2));
    }

    /// A wall ahead, a wall at the side, and a scan of the first of which one point of a thousand seems to see the second, 2 cm off.
    fn wall_and_a_point_beside() -> (PlaneMap, Vec<Selected>) {
        let (mut map, mut selected) = wall(Vector3::zeros());
        for i in 0..2000 {
            let noise = if i % 2 == 0 { 0.005 } else { -0.005 };
            let (x, z) = (1.0 + f64::from(i % 50) * 0.01, f64::from(i / 50) * 0.02);
            map.insert(&Vector3::new(x, 0.6 + noise, z), &Vector3::x());
        }
        selected.push(select(&Isometry3::identity(), &Vector3::new(1.2, 0.58, 0.3)));
        (map, selected)
    }

    #[test]
    fn the_little_that_may_be_false_along_a_wall_makes_one_who_is_unsure_by_a_decimetre_surer_but_slowly() {
        let seen = wall_and_a_point_beside();
        let mut state = State::at_origin();
        let mut covariance = Covariance::zeros();
        add_variance(&mut covariance, at::POSITION, 0.01);
        for _ in 0..5 {
            matched(&seen, &Sections::new(), &mut state, &mut covariance);
        }
        let sigma = covariance[(at::POSITION + 1, at::POSITION + 1)].sqrt();
        // All that the five seem to show would leave 2.5 cm.
        assert!(sigma > 0.03, "{sigma}");
    }

    #[test]
    fn one_who_does_not_know_where_he_is_does_not_believe_the_little_that_is_seen_along_a_wall() {
        let (map, selected) = wall_and_a_point_beside();
        let along = |sigma: f64| {
            let mut state = State::at_origin();
            let mut covariance = Covariance::zeros();
            add_variance(&mut covariance, at::POSITION, sigma * sigma);
            matched(&(map.clone(), selected.clone()), &Sections::new(), &mut state, &mut covariance);
            state.position.y.abs()
        };
        assert!(along(0.1) > 0.003, "{}", along(0.1));
        assert!(along(0.5) < 1e-6, "{}", along(0.5));
    }
}

//! Buildings drawn from a number: corridors in a rectangle, L, U, figure of eight, T or Z, 1.6 to 3 m wide, with doors,
//! rooms, niches, cabinets, ducts and lamps. The same number gives the same building.

mod fittings;
mod layout;
mod openings;

use crate::random::Random;

use super::build::{Along, Site};
use super::material::Material::Concrete;
use super::outline::{Rect, Run, outline};
use super::tour::{Step, Tour};
use layout::Layout;

/// Stream of a building's random numbers; the seeds' streams are small numbers.
const STREAM: u64 = 100;
/// Things that reach below the walker's head keep this far from the way of his axis, metres: the rig is carried 0.15 m
/// before it, its LiDAR up to 0.15 m off the IMU, and he sways.
pub(super) const CLEAR_OF_WAY: f64 = 0.72;

/// How a building is fitted out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Style {
    /// Boxes only.
    Basement,
    /// Also barrels, round pipes, props and rubble.
    Cellar,
}

/// A building under construction, with the way that must stay free.
#[derive(Debug)]
struct Plan {
    site: Site,
    random: Random,
    style: Style,
    ceiling: f64,
    corridors: Vec<Rect>,
    runs: Vec<Run>,
    tour: Tour,
    /// Places before whose walls nothing is hung or opened.
    bare: Vec<[f64; 2]>,
    annexes: Vec<Rect>,
}

/// The building of this number and the way through it.
pub(super) fn build(building: u64, style: Style) -> (Site, Tour) {
    let mut random = Random::new(building, STREAM);
    let layout = Layout::draw(&mut random);
    let ceiling = (random.within(2.3, 3.2) * 20.0).round() / 20.0;
    let tour = tour(&layout, &mut random);
    let bare = tour.places().into_iter().filter(|_| random.chance(0.8)).collect();
    let corridors = layout.corridors();
    let runs = outline(&corridors);
    let mut plan = Plan {
        site: Site::default(),
        random,
        style,
        ceiling,
        corridors,
        runs,
        tour,
        bare,
        annexes: Vec::new(),
    };
    plan.walls();
    plan.fit_out();
    plan.slabs();
    (plan.site, plan.tour)
}

/// The layout's way with stops, and a look at the wall from the middle of some leg.
fn tour(layout: &Layout, random: &mut Random) -> Tour {
    let path = layout.path(random);
    let look = random.below(path.len().saturating_sub(1));
    let mut tour = Tour::along(&path[..1]);
    for (leg, pair) in path.windows(2).enumerate() {
        if leg == look {
            let share = random.within(0.4, 0.6);
            tour.steps.push(Step::To([0, 1].map(|i| pair[0][i] + (pair[1][i] - pair[0][i]) * share)));
            tour.steps.push(Step::Turn(if random.chance(0.5) { 90.0 } else { -90.0 }));
            tour.steps.push(Step::Stand(random.within(0.5, 1.5)));
        }
        tour.steps.push(Step::To(pair[1]));
        if random.chance(0.2) {
            tour.steps.push(Step::Stand(random.within(0.5, 2.0)));
        }
    }
    tour
}

impl Plan {
    fn walls(&mut self) {
        for run in self.runs.clone() {
            let openings = self.openings(&run);
            self.site.wall(run.along, run.body(), run.across(), [0.0, self.ceiling], &openings);
            self.fit(&run, &openings);
        }
    }

    /// Floor and ceiling over everything.
    fn slabs(&mut self) {
        let all = self.corridors.iter().chain(&self.annexes).copied();
        let Some(all) = all.reduce(|a, b| Rect {
            min: [0, 1].map(|i| a.min[i].min(b.min[i])),
            max: [0, 1].map(|i| a.max[i].max(b.max[i])),
        }) else {
            return;
        };
        let [x0, y0] = all.min.map(|low| low - 1.0);
        let [x1, y1] = all.max.map(|high| high + 1.0);
        self.site.block([x0, y0, -0.3], [x1, y1, 0.0], Concrete);
        self.site.block([x0, y0, self.ceiling], [x1, y1, self.ceiling + 0.3], Concrete);
    }

    /// Where along a wall nothing must be, because the walker turns before it.
    fn bare_spans(&self, run: &Run) -> Vec<[f64; 2]> {
        /// Farther walls show no more than a part of themselves in the field of view.
        const BEFORE: f64 = 2.3;
        const REACH: f64 = 1.4;
        let (a, c) = if run.along == Along::X { (0, 1) } else { (1, 0) };
        let before = |place: &&[f64; 2]| {
            let inward = (run.face - place[c]) * run.outward;
            (0.0..BEFORE).contains(&inward) && place[a] > run.span[0] && place[a] < run.span[1]
        };
        self.bare.iter().filter(before).map(|place| [place[a] - REACH, place[a] + REACH]).collect()
    }
}

#[cfg(test)]
mod tests {
    use evac_geometry::nalgebra::Vector3;

    use super::super::bvh::Bvh;
    use super::super::ray::Ray;
    use super::*;

    #[test]
    fn the_same_number_gives_the_same_building_and_other_numbers_others() {
        let describe = |building: u64| format!("{:?}", build(building, Style::Cellar));
        assert_eq!(describe(4), describe(4));
        let all: std::collections::BTreeSet<String> = (0..50).map(describe).collect();
        assert_eq!(all.len(), 50);
    }

    #[test]
    fn most_turns_are_before_a_blank_wall_that_fills_the_view() {
        let (mut turns, mut blank) = (0, 0);
        for building in 1..=20 {
            let (site, tour) = build(building, Style::Basement);
            let tree = Bvh::new(site.solids);
            for leg in tour.places().windows(3) {
                let way = |a: [f64; 2], b: [f64; 2]| Vector3::new(b[0] - a[0], b[1] - a[1], 0.0).normalize();
                let (ahead, next) = (way(leg[0], leg[1]), way(leg[1], leg[2]));
                if ahead.dot(&next) > 0.5 {
                    continue;
                }
                let origin = Vector3::new(leg[1][0], leg[1][1], 1.2) + ahead * 0.15;
                let left = Vector3::z().cross(&ahead);
                let range = |shot: u64| {
                    let beam = crate::mid40::direction(shot * 131);
                    let ray = Ray::new(origin, ahead * beam.x + left * beam.y + Vector3::z() * beam.z);
                    // Along the corridor's axis, so that a wall across it is at one distance.
                    let axis = if ahead.x.abs() > 0.7 { Vector3::x() } else { Vector3::y() };
                    tree.cast(&ray, 90.0).map_or(90.0, |(range, _)| range * ray.direction.dot(&axis).abs())
                };
                let mut ranges: Vec<f64> = (0..300).map(range).collect();
                ranges.sort_by(f64::total_cmp);
                turns += 1;
                blank += usize::from(ranges[290] - ranges[10] < 0.002);
            }
        }
        assert!(turns > 50 && 2 * blank > turns, "{blank} of {turns} turns");
    }
}

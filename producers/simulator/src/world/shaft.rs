//! A landing on the sixth floor drawn from a number: a gallery around a stairwell's eye of 18 m, and a lift shaft behind
//! an open door.

use crate::random::Random;

use super::build::{Along, Site, WALL, door, passage};
use super::material::Material::{Concrete, Metal, Plaster, Sign, Wood};
use super::outline::Rect;
use super::solid::Solid;
use super::tour::{Step, Tour};

const STREAM: u64 = 107;
const CEILING: f64 = 2.7;
const STOREY: f64 = 3.0;
/// Floors below the landing, and above it.
const BELOW: u32 = 4;
const ABOVE: u32 = 1;

/// Along a corridor, around the eye, to the lift and back.
pub(super) fn build(building: u64) -> (Site, Tour) {
    let mut random = Random::new(building, STREAM);
    let (eye, walk) = (random.within(2.4, 3.4), random.within(1.7, 2.1));
    let corridor = random.within(7.0, 9.0);
    // The landing's square, its eye in the middle.
    let side = eye + 2.0 * walk;
    let landing = Rect { min: [corridor, 0.0], max: [corridor + side, side] };
    let (x0, x1) = (corridor + walk / 2.0, corridor + side - walk / 2.0);
    let (y0, y1) = (walk / 2.0, side - walk / 2.0);
    let mut tour = Tour::along(&[[1.2, y0], [x1, y0]]);
    // A look at the lift shaft in the east wall, on the way to the far corner.
    tour.steps.push(Step::To([x1, side / 2.0]));
    tour.steps.push(Step::Turn(-90.0));
    tour.steps.push(Step::Stand(1.5));
    tour.steps.push(Step::To([x1, y1]));
    tour.steps.push(Step::To([x0, y1]));
    // A look over the railing into the eye.
    tour.steps.push(Step::Turn(90.0));
    tour.steps.push(Step::Stand(1.0));
    tour.steps.extend([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0], [2.5, y0]].map(Step::To));
    let mut site = Site::default();
    corridor_walls(&mut site, corridor, walk);
    for floor in 0..=BELOW + ABOVE {
        let base = STOREY * (f64::from(floor) - f64::from(BELOW));
        storey(&mut site, &landing, walk, base, &mut random);
    }
    ends(&mut site, &landing, walk);
    lift(&mut site, &landing, &mut random);
    (site, tour)
}

fn corridor_walls(site: &mut Site, length: f64, width: f64) {
    site.block([-0.3, -0.3, -0.3], [length, width + 0.3, 0.0], Concrete);
    site.block([-0.3, -0.3, CEILING], [length, width + 0.3, STOREY], Concrete);
    let height = [0.0, CEILING];
    site.wall(Along::X, [-WALL, length], [-WALL, 0.0], height, &[door(1.4), door(4.6)]);
    site.wall(Along::X, [-WALL, length - WALL], [width, width + WALL], height, &[door(2.8)]);
    site.wall(Along::Y, [0.0, width], [-WALL, 0.0], height, &[]);
    site.block([2.0, width - 0.12, 0.9], [2.5, width, 1.6], Metal);
    site.block([5.4, width - 0.06, 1.0], [6.4, width, 1.9], Wood);
    site.block([3.0, 0.0, 0.5], [3.2, 0.13, 1.05], Sign);
    site.block([0.4, 0.08, 2.25], [length - 0.4, 0.45, 2.55], Metal);
    site.block([length - 0.6, 0.2, 2.2], [length - 0.55, width - 0.3, 2.45], Sign);
}

/// One floor around the eye: slab, walls, railing.
fn storey(site: &mut Site, landing: &Rect, walk: f64, base: f64, random: &mut Random) {
    let Rect { min: [x0, y0], max: [x1, y1] } = *landing;
    let (low, high) = (base + CEILING - STOREY, base);
    site.block([x0 - WALL, y0 - WALL, low], [x1 + WALL, y0 + walk, high], Concrete);
    site.block([x0 - WALL, y1 - walk, low], [x1 + WALL, y1 + WALL, high], Concrete);
    site.block([x0 - WALL, y0 + walk, low], [x0 + walk, y1 - walk, high], Concrete);
    site.block([x1 - walk, y0 + walk, low], [x1 + WALL, y1 - walk, high], Concrete);
    let height = [base, base + CEILING];
    let here = base == 0.0;
    let middle = (y0 + y1) / 2.0;
    site.wall(Along::X, [x0, x1 + WALL], [y0 - WALL, y0], height, &[door(x0 + random.within(1.5, 3.5))]);
    site.wall(Along::X, [x0, x1 + WALL], [y1, y1 + WALL], height, &[door(x0 + random.within(2.0, 3.5))]);
    let west = [y0 + if here { walk } else { 0.0 }, y1];
    site.wall(Along::Y, west, [x0 - WALL, x0], height, &[door(y1 - 1.4)]);
    let east = if here { passage(middle, 1.1, 2.1) } else { door(middle) };
    site.wall(Along::Y, [y0, y1], [x1, x1 + WALL], height, &[east]);
    railing(site, &Rect { min: [x0 + walk, y0 + walk], max: [x1 - walk, y1 - walk] }, base);
    site.block([x1 - 0.12, y0 + 0.5, base + 0.9], [x1, y0 + 1.0, base + 1.5], Sign);
    site.block([x0, y1 - walk - 0.4, base + 0.15], [x0 + 0.1, y1 - walk + 0.6, base + 0.7], Metal);
}

/// Posts, a handrail and thin bars around the eye.
fn railing(site: &mut Site, eye: &Rect, base: f64) {
    let Rect { min: [x0, y0], max: [x1, y1] } = *eye;
    let corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
    for (a, b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
        for (z, radius) in [(1.0, 0.03), (0.1, 0.015)] {
            site.solids.push(Solid::pipe([a[0], a[1], base + z], [b[0], b[1], base + z], radius, Metal));
        }
        let bars = ((b[0] - a[0]).hypot(b[1] - a[1]) / 0.14) as u32;
        for bar in 0..bars {
            let share = f64::from(bar) / f64::from(bars);
            let [x, y] = [0, 1].map(|i| a[i] + (b[i] - a[i]) * share);
            let radius = if bar == 0 { 0.03 } else { 0.008 };
            site.solids.push(Solid::pipe([x, y, base], [x, y, base + 1.0], radius, Metal));
        }
    }
}

/// The ground of the eye and the roof above it.
fn ends(site: &mut Site, landing: &Rect, walk: f64) {
    let [x0, y0] = landing.min.map(|low| low + walk - 0.1);
    let [x1, y1] = landing.max.map(|high| high - walk + 0.1);
    let ground = -STOREY * f64::from(BELOW);
    site.block([x0, y0, ground - 0.3], [x1, y1, ground], Concrete);
    let [x0, y0] = landing.min.map(|low| low - WALL);
    let [x1, y1] = landing.max.map(|high| high + WALL);
    let roof = STOREY * f64::from(ABOVE + 1);
    site.block([x0, y0, roof - 0.3], [x1, y1, roof], Concrete);
}

/// A shaft 1.9 m square over all floors, with rails, brackets, cables and the cabin far below.
fn lift(site: &mut Site, landing: &Rect, random: &mut Random) {
    const SIZE: f64 = 1.9;
    let x0 = landing.max[0] + WALL;
    let y0 = (landing.min[1] + landing.max[1]) / 2.0 - SIZE / 2.0;
    let (x1, y1) = (x0 + SIZE, y0 + SIZE);
    let (low, high) = (-STOREY * f64::from(BELOW), STOREY * f64::from(ABOVE + 1));
    site.block([x0, y0 - 0.2, low], [x1 + 0.2, y0, high], Plaster);
    site.block([x0, y1, low], [x1 + 0.2, y1 + 0.2, high], Plaster);
    site.block([x1, y0, low], [x1 + 0.2, y1, high], Plaster);
    site.block([x0, y0, low - 0.2], [x1, y1, low], Concrete);
    site.block([x0, y0, high], [x1, y1, high + 0.2], Concrete);
    let middle = (y0 + y1) / 2.0;
    for y in [y0 + 0.06, y1 - 0.06] {
        site.block([x0 + 0.9, y - 0.05, low], [x0 + 1.0, y + 0.05, high], Metal);
        let mut z = low + 0.5;
        while z < high {
            site.block([x0 + 0.8, y - 0.06, z], [x0 + 1.1, y + 0.06, z + 0.08], Metal);
            z += 1.5;
        }
    }
    for offset in [-0.15, -0.05, 0.05, 0.15] {
        site.solids.push(Solid::pipe(
            [x0 + 1.0, middle + offset, low],
            [x0 + 1.0, middle + offset, high],
            0.012,
            Metal,
        ));
    }
    let cabin = low + random.within(1.0, 4.0);
    site.block([x0 + 0.15, y0 + 0.2, cabin], [x1 - 0.15, y1 - 0.2, cabin + 2.3], Metal);
}

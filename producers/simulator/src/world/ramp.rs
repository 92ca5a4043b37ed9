//! A bent corridor drawn from a number whose floor and ceiling climb with two ramps, and go down again on a third.

use crate::random::Random;

use super::build::{Along, Site, WALL};
use super::material::Material::{Concrete, Metal, Plaster, Sign, Wood};
use super::solid::Solid;
use super::tour::{Step, Tour};

const STREAM: u64 = 106;
const CEILING: f64 = 2.6;
/// A slope sets in over this way, half before and half behind the slab's edge (as walked), metres.
const ONSET: f64 = 0.5;

/// One straight corridor: from and to on its centre line, floor heights at both ends, the slope between two distances.
struct Leg {
    along: Along,
    from: [f64; 2],
    length: f64,
    /// +1 or -1 along its axis.
    sign: f64,
    floor: f64,
    slope: [f64; 2],
    rise: f64,
}

/// The corridors of this number: up to the east, up to the north, down to the west, and half the way back.
pub(super) fn build(building: u64) -> (Site, Tour) {
    let mut random = Random::new(building, STREAM);
    let half = random.within(0.95, 1.3);
    let (l, w, b) = (random.within(12.0, 15.0), random.within(10.0, 12.0), random.within(11.0, 13.0));
    let rises = [random.within(0.7, 1.2), random.within(0.6, 1.0), -random.within(0.6, 1.1)];
    let leg = |along, from, length, sign, floor, rise| {
        let slope = [2.0 + half, length - 2.0 - half];
        Leg { along, from, length, sign, floor, slope, rise }
    };
    let legs = [
        leg(Along::X, [0.0, 0.0], l, 1.0, 0.0, rises[0]),
        leg(Along::Y, [l, 0.0], w, 1.0, rises[0], rises[1]),
        leg(Along::X, [l, w], b, -1.0, rises[0] + rises[1], rises[2]),
    ];
    let mut site = Site::default();
    for (index, leg) in legs.iter().enumerate() {
        leg.build(&mut site, half, &mut random, index);
    }
    let top = 6.5;
    let wall = |site: &mut Site, along, span, across| site.wall(along, span, across, [-0.6, top], &[]);
    // Both sides of each leg, between the others; the ends.
    wall(&mut site, Along::X, [-1.0 - WALL, l + half + WALL], [-half - WALL, -half]);
    wall(&mut site, Along::X, [-1.0 - WALL, l - half], [half, half + WALL]);
    wall(&mut site, Along::Y, [-half, half], [-1.0 - WALL, -1.0]);
    wall(&mut site, Along::Y, [-half, w + half], [l + half, l + half + WALL]);
    wall(&mut site, Along::Y, [half, w - half], [l - half - WALL, l - half]);
    wall(&mut site, Along::X, [l - b - 1.0 - WALL, l + half + WALL], [w + half, w + half + WALL]);
    wall(&mut site, Along::X, [l - b - 1.0 - WALL, l - half], [w - half - WALL, w - half]);
    wall(&mut site, Along::Y, [w - half, w + half], [l - b - 1.0 - WALL, l - b - 1.0]);
    let climb = |leg: &Leg| Step::Climb(leg.at(leg.length), leg.slope, leg.rise);
    let mut steps: Vec<Step> = legs.iter().map(climb).collect();
    steps.insert(2, Step::Stand(1.0));
    steps.push(Step::Turn(180.0));
    steps.push(Step::Stand(0.5));
    (site, Tour { start: [0.0, 0.0], floor: 0.0, steps })
}

impl Leg {
    /// The place on the centre line after `way` metres.
    fn at(&self, way: f64) -> [f64; 2] {
        match self.along {
            Along::X => [self.from[0] + self.sign * way, self.from[1]],
            Along::Y => [self.from[0], self.from[1] + self.sign * way],
        }
    }

    /// The floor's height after `way` metres.
    fn height(&self, way: f64) -> f64 {
        let [from, to] = self.slope;
        let share = (way - from - ONSET / 2.0) / (to - from - ONSET);
        self.floor + self.rise * share.clamp(0.0, 1.0)
    }

    /// The place after `way` metres, `left` of the centre line and `up` from the floor.
    fn place(&self, way: f64, left: f64, up: f64) -> [f64; 3] {
        let [x, y] = self.at(way);
        let left = self.sign * left;
        match self.along {
            Along::X => [x, y + left, self.height(way) + up],
            Along::Y => [x - left, y, self.height(way) + up],
        }
    }

    fn build(&self, site: &mut Site, half: f64, random: &mut Random, index: usize) {
        let (low, high) = (self.slope[0] + ONSET / 2.0, self.slope[1] - ONSET / 2.0);
        let before = if index == 0 { -1.2 } else { -half };
        let after = self.length + if index == 2 { 1.2 } else { half };
        for up in [-0.15, CEILING + 0.15] {
            self.slab(site, [before, low], half, up);
            self.slab(site, [low, high], half, up);
            self.slab(site, [high, after], half, up);
        }
        // Handrails on posts, on the right all along and on the left for a part.
        for (left, share) in [(-half + 0.08, 1.0), (half - 0.08, random.within(0.3, 0.7))] {
            let end = low + (high - low) * share;
            let rail = Solid::pipe(self.place(low, left, 0.9), self.place(end, left, 0.9), 0.025, Metal);
            site.solids.push(rail);
            let mut way = low + 0.1;
            while way < end {
                site.solids.push(Solid::pipe(
                    self.place(way, left, 0.0),
                    self.place(way, left, 0.9),
                    0.02,
                    Metal,
                ));
                way += 1.3;
            }
        }
        let duct =
            Solid::pipe(self.place(low, 0.5 * half, 2.3), self.place(high, 0.5 * half, 2.3), 0.14, Metal);
        site.solids.push(duct);
        for _ in 0..9 {
            self.fitting(site, half, random);
        }
    }

    /// Something at a wall, flat enough to pass.
    fn fitting(&self, site: &mut Site, half: f64, random: &mut Random) {
        let way = random.within(half + 1.2, self.length - half - 1.2);
        let side = if random.chance(0.5) { 1.0 } else { -1.0 };
        let (depth, width) = (random.within(0.04, half - 0.78).max(0.05), random.within(0.2, 1.4));
        let (low, high, material) = match random.below(5) {
            0 => (0.0, 1.9, Metal),
            1 => (0.9, 1.7, Wood),
            2 => (0.5, 1.05, Sign),
            3 => (0.0, CEILING, Plaster),
            _ => (1.1, 2.0, Metal),
        };
        let [x, y, z] = self.place(way, side * (half - depth / 2.0), (low + high) / 2.0);
        // Down to the floor on the lower side of a slope too.
        let tall = high - low + if low == 0.0 { 0.3 } else { 0.0 };
        let size = match self.along {
            Along::X => [width, depth, tall],
            Along::Y => [depth, width, tall],
        };
        site.turned([x, y, z - (tall - high + low) / 2.0], size, 0.0, material);
    }

    /// A piece of floor or ceiling: a box along the leg from `span[0]` to `span[1]`, its middle `up` above the floor.
    fn slab(&self, site: &mut Site, [from, to]: [f64; 2], half: f64, up: f64) {
        let (a, b) = (self.height(from + 1e-6), self.height(to - 1e-6));
        let (long, climb) = (to - from, b - a);
        let [x, y, _] = self.place((from + to) / 2.0, 0.0, 0.0);
        let pitch = -(climb / long).atan().to_degrees();
        let yaw = match (self.along, self.sign > 0.0) {
            (Along::X, true) => 0.0,
            (Along::X, false) => 180.0,
            (Along::Y, true) => 90.0,
            (Along::Y, false) => -90.0,
        };
        // A little longer than its part, so that no slit is left where slabs meet at an angle.
        let size = [long.hypot(climb) + 0.02, 2.0 * half + 0.2, 0.3];
        site.solids.push(Solid::tilted([x, y, (a + b) / 2.0 + up], size, [0.0, pitch, yaw], Concrete));
    }
}

//! Fitting a building out at random without standing in the walker's way.

use crate::random::Random;

use super::build::Site;
use super::floor_plan::CLEAR_OF_WAY;
use super::outline::Rect;
use super::people::Person;
use super::solid::Solid;
use super::tour::Tour;

/// Below this things are in the way of a walker, metres.
pub(super) const HEADROOM: f64 = 1.95;

/// A building with its tour and its own random numbers.
#[derive(Debug)]
pub(super) struct Fitter {
    pub(super) site: Site,
    pub(super) random: Random,
    pub(super) tour: Tour,
    taken: Vec<Rect>,
}

impl Fitter {
    pub(super) fn new(tour: Tour, random: Random) -> Self {
        Self { site: Site::default(), random, tour, taken: Vec::new() }
    }

    /// Puts something together from parts, as a whole or not at all: every part that reaches below a head keeps clear of
    /// the way, and the whole of what was put before. Floors are at height 0.
    pub(super) fn put(&mut self, parts: Vec<Solid>) -> bool {
        let footprint = |solid: &Solid| {
            let bounds = solid.bounds();
            (bounds.min.z < HEADROOM)
                .then(|| Rect { min: [bounds.min.x, bounds.min.y], max: [bounds.max.x, bounds.max.y] })
        };
        let whole = parts.iter().filter_map(footprint).reduce(|a, b| Rect {
            min: [0, 1].map(|i| a.min[i].min(b.min[i])),
            max: [0, 1].map(|i| a.max[i].max(b.max[i])),
        });
        if let Some(whole) = whole {
            let taken = self.taken.iter().any(|other| whole.overlaps(other, 0.02));
            if taken
                || parts.iter().filter_map(footprint).any(|part| self.tour.distance(&part) < CLEAR_OF_WAY)
            {
                return false;
            }
            self.taken.push(whole);
        }
        self.site.solids.extend(parts);
        true
    }

    /// A free place for people: nothing is put there any more.
    pub(super) fn person(&mut self, path: &[[f64; 2]], speed: f64, start: f64) {
        for pair in path.windows(2) {
            self.taken.push(Rect::around(pair[0], pair[1], 0.55));
        }
        self.site.people.push(Person::new(path, speed, start));
    }

    /// A place in a rectangle, `margin` metres from its border.
    pub(super) fn place(&mut self, rect: &Rect, margin: f64) -> [f64; 2] {
        [0, 1].map(|i| self.random.within(rect.min[i] + margin, rect.max[i] - margin))
    }
}

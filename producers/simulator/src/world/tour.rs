//! What a walker does in a building, before speeds make a route of it.

use crate::trajectory::Route;

use super::outline::Rect;

/// One thing to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Step {
    /// Turn on the spot towards it where needed, and walk there.
    To([f64; 2]),
    /// As `To`, over a slope or stair of `rise` metres between two distances from the leg's start.
    Climb([f64; 2], [f64; 2], f64),
    /// Stand still, seconds.
    Stand(f64),
    /// Turn on the spot, degrees, left positive.
    Turn(f64),
}

/// A start on the floor and what follows.
#[derive(Debug, Clone)]
pub(super) struct Tour {
    pub(super) start: [f64; 2],
    /// Height of the floor there, metres.
    pub(super) floor: f64,
    pub(super) steps: Vec<Step>,
}

impl Tour {
    /// Along the corners of a path.
    pub(super) fn along(path: &[[f64; 2]]) -> Self {
        let (start, rest) = path.split_first().map_or(([0.0; 2], path), |(first, rest)| (*first, rest));
        Self { start, floor: 0.0, steps: rest.iter().copied().map(Step::To).collect() }
    }

    /// The places at which the walker stands, turns or ends, the start first.
    pub(super) fn places(&self) -> Vec<[f64; 2]> {
        let ends = self.steps.iter().filter_map(|step| match step {
            Step::To(place) | Step::Climb(place, ..) => Some(*place),
            Step::Stand(_) | Step::Turn(_) => None,
        });
        std::iter::once(self.start).chain(ends).collect()
    }

    /// Distance of a rectangle on the floor from the walker's way, metres.
    pub(super) fn distance(&self, rect: &Rect) -> f64 {
        /// The way is looked at in steps of this length.
        const STEP: f64 = 0.05;
        let outside = |p: [f64; 2]| {
            let beyond = [0, 1].map(|i| (rect.min[i] - p[i]).max(p[i] - rect.max[i]).max(0.0));
            beyond[0].hypot(beyond[1])
        };
        let along = |pair: &[[f64; 2]]| {
            let [[ax, ay], [bx, by]] = [pair[0], pair[1]];
            let steps = ((bx - ax).hypot(by - ay) / STEP).ceil().max(1.0);
            (0..=steps as u32)
                .map(|k| f64::from(k) / steps)
                .map(|share| outside([ax + (bx - ax) * share, ay + (by - ay) * share]))
                .fold(f64::INFINITY, f64::min)
        };
        self.places().windows(2).map(along).fold(f64::INFINITY, f64::min)
    }

    /// The route: three and a half seconds of standing, the steps, one second of standing.
    pub(super) fn route(&self, start: impl Fn([f64; 3], f64) -> Route) -> Route {
        let [x, y] = self.start;
        let heading = self.places().get(1).map_or(0.0, |next| (next[1] - y).atan2(next[0] - x).to_degrees());
        let route =
            self.steps.iter().fold(
                start([x, y, self.floor], heading).stand(3.5),
                |route, step| match *step {
                    Step::To([x, y]) => route.walk_to(x, y),
                    Step::Climb([x, y], between, rise) => route.climb_to(x, y, between, rise),
                    Step::Stand(seconds) => route.stand(seconds),
                    Step::Turn(degrees) => route.turn(degrees),
                },
            );
        route.stand(1.0)
    }
}

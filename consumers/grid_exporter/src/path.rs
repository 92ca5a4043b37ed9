//! Where the sensor has been.

use evac_stage::{StageError, State};

/// Points kept; at the starting spacing they cover 20 km.
const MAX_POINTS: usize = 200_000;
/// Metres between two kept points at the start.
const SPACING_M: f64 = 0.1;

/// The sensor's way, thinned by distance. When it is full every second point is dropped and the spacing doubled.
pub(crate) struct Path {
    points: Vec<[f64; 3]>,
    spacing: f64,
    max_points: usize,
    last: Option<[f64; 3]>,
}

impl Path {
    pub(crate) fn new() -> Self {
        Self::with_capacity(MAX_POINTS)
    }

    fn with_capacity(max_points: usize) -> Self {
        Self { points: Vec::new(), spacing: SPACING_M, max_points, last: None }
    }

    /// Takes a position in metres; false when it is not finite.
    pub(crate) fn push(&mut self, position: [f64; 3]) -> bool {
        if position.iter().any(|axis| !axis.is_finite()) {
            return false;
        }
        self.last = Some(position);
        let step = self.points.last().map_or(f64::INFINITY, |previous| distance(previous, &position));
        if step < self.spacing {
            return true;
        }
        if self.points.len() >= self.max_points {
            let mut index = 0;
            self.points.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.spacing *= 2.0;
        }
        self.points.push(position);
        true
    }

    /// Writes it down for another exporter.
    pub(crate) fn save(&self, state: &mut State) {
        state.put_reals(&[self.spacing]);
        state.put_reals(&self.last.unwrap_or([f64::NAN; 3]));
        state.put(self.points.len() as u64);
        self.points.iter().for_each(|point| state.put_reals(point));
    }

    /// Takes over another exporter's.
    pub(crate) fn load(&mut self, state: &mut State) -> Result<(), StageError> {
        let [spacing] = state.reals()?;
        self.spacing = spacing;
        self.last = Some(state.reals()?).filter(|last: &[f64; 3]| last.iter().all(|axis| axis.is_finite()));
        self.points.clear();
        for _ in 0..state.number()? {
            self.points.push(state.reals()?);
        }
        Ok(())
    }

    /// The thinned positions, the latest one last.
    pub(crate) fn points(&self) -> impl DoubleEndedIterator<Item = [f64; 3]> {
        let last = self.last.filter(|last| self.points.last() != Some(last));
        self.points.iter().copied().chain(last)
    }

    /// What lies at heights that `shown` accepts, metres.
    pub(crate) fn route(&self, shown: impl Fn(f64) -> bool) -> Route {
        let (mut route, mut shown_before, mut first) = (Route::default(), false, true);
        for [x, y, z] in self.points() {
            let shows = shown(z);
            match route.legs.last_mut() {
                Some(leg) if shows && shown_before => {
                    route.length += leg.last().map_or(0.0, |[px, py]| (x - px).hypot(y - py));
                    leg.push([x, y]);
                }
                _ if shows => route.legs.push(vec![[x, y]]),
                _ => {}
            }
            route.has_ends = [route.has_ends[0] || first && shows, shows];
            (shown_before, first) = (shows, false);
        }
        route
    }
}

/// The part of a path that is drawn on one plan.
#[derive(Debug, Default)]
pub(crate) struct Route {
    /// Stretches without a break, metres.
    pub(crate) legs: Vec<Vec<[f64; 2]>>,
    /// Whether the first leg begins where the whole path begins, and the last one ends where it ends.
    pub(crate) has_ends: [bool; 2],
    /// Metres.
    pub(crate) length: f64,
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_walk_has_its_length_and_ends_where_it_ended() {
        let mut path = Path::new();
        (0..=1000).for_each(|i| assert!(path.push([f64::from(i) * 0.0301, 0.0, 1.0])));
        let route = path.route(|_| true);
        assert!((route.length - 30.1).abs() < 0.13, "{}", route.length);
        assert_eq!((route.legs.len(), route.has_ends), (1, [true; 2]));
        assert_eq!(path.points().next_back(), Some([1000.0 * 0.0301, 0.0, 1.0]));
    }

    #[test]
    fn a_way_up_and_down_again_is_drawn_on_each_storey_in_its_pieces() {
        let mut path = Path::new();
        (0..=100).for_each(|i| {
            assert!(path.push([f64::from(i), 0.0, if (40..60).contains(&i) { 3.0 } else { 0.0 }]))
        });
        let (below, above) = (path.route(|z| z < 1.5), path.route(|z| z > 1.5));
        assert_eq!((below.legs.len(), below.has_ends), (2, [true; 2]));
        assert_eq!((above.legs.len(), above.has_ends), (1, [false; 2]));
        assert!((above.length - 19.0).abs() < 1e-9);
    }

    #[test]
    fn memory_is_bounded_and_start_and_end_stay() {
        let mut path = Path::with_capacity(100);
        (0..100_000).for_each(|i| assert!(path.push([f64::from(i), 0.0, 0.0])));
        assert!(path.points().count() <= 101);
        assert_eq!(path.points().next(), Some([0.0; 3]));
        assert_eq!(path.points().next_back(), Some([99_999.0, 0.0, 0.0]));
    }

    #[test]
    fn a_position_that_is_not_finite_is_refused() {
        assert!(!Path::new().push([0.0, f64::NAN, 0.0]));
    }
}

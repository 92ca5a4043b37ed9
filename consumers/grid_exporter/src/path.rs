//! Where the sensor has been.

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
    length: f64,
}

impl Path {
    pub(crate) fn new() -> Self {
        Self::with_capacity(MAX_POINTS)
    }

    fn with_capacity(max_points: usize) -> Self {
        Self { points: Vec::new(), spacing: SPACING_M, max_points, last: None, length: 0.0 }
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
        if step.is_finite() {
            self.length += step;
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

    /// The thinned positions, the latest one last.
    pub(crate) fn points(&self) -> impl DoubleEndedIterator<Item = [f64; 3]> {
        let last = self.last.filter(|last| self.points.last() != Some(last));
        self.points.iter().copied().chain(last)
    }

    /// Length of the way in metres, without what lies under the spacing (sway at standstill).
    pub(crate) fn length(&self) -> f64 {
        self.length
    }
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
        assert!((path.length() - 30.1).abs() < 0.13, "{}", path.length());
        assert_eq!(path.points().next_back(), Some([1000.0 * 0.0301, 0.0, 1.0]));
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

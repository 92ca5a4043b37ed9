//! From the rectangles that people walk in to the walls around them.

use super::build::{Along, WALL};

/// A rectangle on the floor, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rect {
    pub(super) min: [f64; 2],
    pub(super) max: [f64; 2],
}

impl Rect {
    pub(super) fn around(a: [f64; 2], b: [f64; 2], margin: f64) -> Self {
        Self { min: [0, 1].map(|i| a[i].min(b[i]) - margin), max: [0, 1].map(|i| a[i].max(b[i]) + margin) }
    }

    pub(super) fn overlaps(&self, other: &Self, margin: f64) -> bool {
        (0..2).all(|i| self.min[i] < other.max[i] + margin && other.min[i] < self.max[i] + margin)
    }

    pub(super) fn contains(&self, [x, y]: [f64; 2]) -> bool {
        x > self.min[0] && x < self.max[0] && y > self.min[1] && y < self.max[1]
    }
}

/// A straight wall on the border of the area walked in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Run {
    pub(super) along: Along,
    /// From where to where it can be seen, along its direction.
    pub(super) span: [f64; 2],
    /// The coordinate across of the face that is seen.
    pub(super) face: f64,
    /// +1 or -1: to which side of the face the wall's body lies.
    pub(super) outward: f64,
    /// Whether the area ends with the wall's low and high end, so that the wall has to close the corner.
    closes: [bool; 2],
}

impl Run {
    /// The span of the wall's body, corners closed.
    pub(super) fn body(&self) -> [f64; 2] {
        let reach = self.closes.map(|closes| if closes { WALL } else { 0.0 });
        [self.span[0] - reach[0], self.span[1] + reach[1]]
    }

    /// Both coordinates across of the wall's body, the lower first.
    pub(super) fn across(&self) -> [f64; 2] {
        let back = self.face + self.outward * WALL;
        [self.face.min(back), self.face.max(back)]
    }

    /// The place `at` along the wall and `inward` metres before its face.
    pub(super) fn place(&self, at: f64, inward: f64) -> [f64; 2] {
        let across = self.face - self.outward * inward;
        match self.along {
            Along::X => [at, across],
            Along::Y => [across, at],
        }
    }

    /// The rectangle between `span` along the wall and two distances before its face (negative: behind it).
    pub(super) fn rect(&self, span: [f64; 2], inward: [f64; 2]) -> Rect {
        Rect::around(self.place(span[0], inward[0]), self.place(span[1], inward[1]), 0.0)
    }

    pub(super) fn length(&self) -> f64 {
        self.span[1] - self.span[0]
    }
}

/// The walls around the union of rectangles.
pub(super) fn outline(rects: &[Rect]) -> Vec<Run> {
    let mut runs = runs_along(rects, Along::X);
    runs.extend(runs_along(rects, Along::Y));
    runs
}

fn runs_along(rects: &[Rect], along: Along) -> Vec<Run> {
    let (a, c) = match along {
        Along::X => (0, 1),
        Along::Y => (1, 0),
    };
    let (stations, faces) = (edges(rects, a), edges(rects, c));
    // Whether the cell after station `i` and after face `k` is walked in; index 0 is before the first.
    let middle = |edges: &[f64], i: usize| match (i.checked_sub(1).and_then(|i| edges.get(i)), edges.get(i)) {
        (Some(low), Some(high)) => Some((low + high) / 2.0),
        _ => None,
    };
    let inside = |i: usize, k: usize| {
        let (Some(at), Some(across)) = (middle(&stations, i), middle(&faces, k)) else { return false };
        let place = if along == Along::X { [at, across] } else { [across, at] };
        rects.iter().any(|rect| rect.contains(place))
    };
    let mut runs = Vec::new();
    for (k, face) in faces.iter().enumerate() {
        for (outward, seen, hidden) in [(1.0, k, k + 1), (-1.0, k + 1, k)] {
            let border = |i: usize| inside(i, seen) && !inside(i, hidden);
            let mut i = 1;
            while i < stations.len() {
                if !border(i) {
                    i += 1;
                    continue;
                }
                let first = i;
                while border(i) {
                    i += 1;
                }
                let closes = [!inside(first - 1, seen), !inside(i, seen)];
                let span = [stations[first - 1], stations[i - 1]];
                runs.push(Run { along, span, face: *face, outward, closes });
            }
        }
    }
    runs
}

fn edges(rects: &[Rect], axis: usize) -> Vec<f64> {
    let mut edges: Vec<f64> = rects.iter().flat_map(|rect| [rect.min[axis], rect.max[axis]]).collect();
    edges.sort_by(f64::total_cmp);
    edges.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    edges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_l_has_six_walls_of_which_the_inner_two_leave_their_common_corner_open() {
        let rects = [Rect { min: [0.0, 0.0], max: [10.0, 2.0] }, Rect { min: [8.0, 0.0], max: [10.0, 6.0] }];
        let runs = outline(&rects);
        assert_eq!(runs.len(), 6);
        let inner = runs.iter().find(|run| run.along == Along::X && run.span == [0.0, 8.0]).unwrap();
        assert_eq!((inner.face, inner.outward), (2.0, 1.0));
        assert_eq!(inner.body(), [-WALL, 8.0]);
        let outer = runs.iter().find(|run| run.along == Along::Y && run.face == 10.0).unwrap();
        assert_eq!((outer.span, outer.body()), ([0.0, 6.0], [-WALL, 6.0 + WALL]));
        assert_eq!(outer.place(1.0, 0.5), [9.5, 1.0]);
        let around: f64 = runs.iter().map(Run::length).sum();
        assert!((around - 32.0).abs() < 1e-9);
    }

    #[test]
    fn a_ring_has_four_walls_outside_and_four_inside() {
        let lane = |a, b| Rect::around(a, b, 1.0);
        let rects = [
            lane([0.0, 0.0], [10.0, 0.0]),
            lane([10.0, 0.0], [10.0, 8.0]),
            lane([10.0, 8.0], [0.0, 8.0]),
            lane([0.0, 8.0], [0.0, 0.0]),
        ];
        assert_eq!(outline(&rects).len(), 8);
    }
}

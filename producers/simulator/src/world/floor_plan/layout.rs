//! Which corridors there are and how one walks through them.

use crate::random::Random;

use super::super::outline::Rect;

/// Corridors end this far behind the last place walked to, metres.
const DEAD_END: f64 = 1.0;

/// Corridors by their centre lines.
#[derive(Debug, Clone)]
pub(in super::super) struct Layout {
    nodes: Vec<[f64; 2]>,
    /// Two nodes and the corridor's width, metres.
    edges: Vec<(usize, usize, f64)>,
    /// The way through it, by nodes.
    pub(in super::super) way: Vec<usize>,
}

impl Layout {
    /// Draws a layout: a rectangle, L, U, figure of eight, T or Z, with the left hand on either side.
    pub(in super::super) fn draw(random: &mut Random) -> Self {
        let kind = random.below(6);
        Self::of_kind(kind, random)
    }

    pub(in super::super) fn of_kind(kind: usize, random: &mut Random) -> Self {
        let mut width = [0.0; 8].map(|_: f64| (random.within(1.6, 3.0) * 20.0).round() / 20.0).into_iter();
        let mut size = |low: f64, high: f64| (random.within(low, high) * 20.0).round() / 20.0;
        let (nodes, edges, way) = match kind {
            0 => {
                let (l, w) = (size(11.0, 16.0), size(7.0, 10.0));
                let nodes = vec![[0.0, 0.0], [l, 0.0], [l, w], [0.0, w]];
                (nodes, vec![[0, 1], [1, 2], [2, 3], [3, 0]], vec![0, 1, 2, 3, 0, 1])
            }
            1 => {
                let (l, w) = (size(10.0, 14.0), size(7.0, 10.0));
                (vec![[0.0, 0.0], [l, 0.0], [l, w]], vec![[0, 1], [1, 2]], vec![0, 1, 2, 1, 0])
            }
            2 => {
                let (l, w, d) = (size(9.0, 12.0), size(7.0, 9.0), size(2.0, 5.0));
                let nodes = vec![[0.0, 0.0], [l, 0.0], [l, w], [-d, w]];
                (nodes, vec![[0, 1], [1, 2], [2, 3]], vec![0, 1, 2, 3, 2])
            }
            3 => {
                let (l, m, w) = (size(5.5, 7.0), size(5.5, 7.0), size(6.0, 8.0));
                let nodes = vec![[0.0, 0.0], [l, 0.0], [l + m, 0.0], [l + m, w], [l, w], [0.0, w]];
                let edges = vec![[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 0], [1, 4]];
                (nodes, edges, vec![0, 1, 4, 5, 0, 1, 2, 3, 4, 1])
            }
            4 => {
                let (l, m, w) = (size(6.0, 8.0), size(6.0, 8.0), size(7.0, 10.0));
                let nodes = vec![[0.0, 0.0], [l, 0.0], [l + m, 0.0], [l, w]];
                (nodes, vec![[0, 1], [1, 2], [1, 3]], vec![0, 1, 3, 1, 2, 1])
            }
            _ => {
                let (l, m, w, v) = (size(8.0, 10.0), size(7.0, 9.0), size(6.0, 8.0), size(6.0, 7.0));
                let nodes = vec![[0.0, 0.0], [l, 0.0], [l, w], [l + m, w], [l + m, w + v]];
                (nodes, vec![[0, 1], [1, 2], [2, 3], [3, 4]], vec![0, 1, 2, 3, 4, 3])
            }
        };
        let edges = edges.into_iter().map(|[a, b]: [usize; 2]| (a, b, width.next().unwrap_or(2.0))).collect();
        let mirrored = random.chance(0.5);
        let nodes = nodes.into_iter().map(|[x, y]: [f64; 2]| [x, if mirrored { -y } else { y }]).collect();
        Self { nodes, edges, way }
    }

    /// Every corridor's floor, closed at corners.
    pub(in super::super) fn corridors(&self) -> Vec<Rect> {
        let lane = |&(a, b, width): &(usize, usize, f64)| {
            let (from, to) = (self.nodes[a], self.nodes[b]);
            let axis = usize::from((to[1] - from[1]).abs() > (to[0] - from[0]).abs());
            let mut rect = Rect::around(from, to, width / 2.0);
            let (low, high) = if from[axis] < to[axis] { (a, b) } else { (b, a) };
            rect.min[axis] = self.nodes[low][axis] - self.reach(low, (a, b));
            rect.max[axis] = self.nodes[high][axis] + self.reach(high, (a, b));
            rect
        };
        self.edges.iter().map(lane).collect()
    }

    /// How far a corridor goes on behind its node: over the half width of those that meet it across.
    fn reach(&self, node: usize, edge: (usize, usize)) -> f64 {
        let others = self.edges.iter().filter(|(a, b, _)| (*a, *b) != edge && (*a == node || *b == node));
        let widths = others.filter(|(a, b, _)| self.is_along_x(*a, *b) != self.is_along_x(edge.0, edge.1));
        widths.map(|(_, _, width)| width / 2.0).reduce(f64::max).unwrap_or_else(|| {
            let goes_on = self.edges.iter().filter(|(a, b, _)| *a == node || *b == node).count() > 1;
            if goes_on { 0.0 } else { DEAD_END }
        })
    }

    fn is_along_x(&self, a: usize, b: usize) -> bool {
        let (a, b) = (self.nodes[a], self.nodes[b]);
        (b[0] - a[0]).abs() > (b[1] - a[1]).abs()
    }

    /// The places walked to, a little off the centre lines as people are; the last leg may end early.
    pub(in super::super) fn path(&self, random: &mut Random) -> Vec<[f64; 2]> {
        let mut path: Vec<[f64; 2]> = Vec::with_capacity(self.way.len());
        for &node in &self.way {
            let [x, y] = self.nodes[node];
            path.push([x + random.within(-0.1, 0.1), y + random.within(-0.1, 0.1)]);
        }
        if let [.., before, last] = path.as_mut_slice() {
            let share = random.within(0.5, 0.95);
            *last = [0, 1].map(|i| before[i] + (last[i] - before[i]) * share);
        }
        path
    }
}

//! A bounding volume hierarchy: the nearest of some hundred boxes in a few box tests a ray.

use super::ray::{Bounds, Ray};
use super::solid::Solid;

/// Solids in one leaf.
const LEAF: usize = 3;
/// Nodes that wait while one is looked at: one a level. Each split leaves at most 7/8 of the solids on a side, so this is
/// enough for 3 * (8/7)^60 = 9000 solids; more are halved.
const MAX_DEPTH: usize = 64;
/// From so many solids on (a measured cloud, all of one size) every split halves, which is quick to build and 20 levels
/// deep with a million.
const MANY: usize = 8000;

#[derive(Debug, Clone)]
struct Node {
    bounds: Bounds,
    /// First solid of a leaf, or the right child of an inner node (its left child is the next node).
    first: usize,
    /// Solids of a leaf, 0 for an inner node.
    count: usize,
}

/// The tree and its solids, in the order of the leaves.
#[derive(Debug, Clone)]
pub(super) struct Bvh {
    nodes: Vec<Node>,
    solids: Vec<Solid>,
}

impl Bvh {
    pub(super) fn new(mut solids: Vec<Solid>) -> Self {
        let mut nodes = Vec::with_capacity(solids.len());
        let count = solids.len();
        if count > 0 {
            build(&mut nodes, &mut solids, 0, count, count > MANY);
        }
        Self { nodes, solids }
    }

    pub(super) fn solids(&self) -> &[Solid] {
        &self.solids
    }

    /// The nearest solid nearer than `limit`, with its distance.
    pub(super) fn cast(&self, ray: &Ray, limit: f64) -> Option<(f64, &Solid)> {
        let mut best = None;
        let mut nearest = limit;
        let mut stack = [(0_usize, 0.0_f64); MAX_DEPTH];
        let mut depth = usize::from(!self.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            let (index, enter) = stack[depth];
            if enter >= nearest {
                continue;
            }
            let node = &self.nodes[index];
            if node.count > 0 {
                for solid in &self.solids[node.first..node.first + node.count] {
                    if let Some(range) = solid.hit(ray, nearest) {
                        nearest = range;
                        best = Some((range, solid));
                    }
                }
                continue;
            }
            let enter = |child: usize| {
                self.nodes[child]
                    .bounds
                    .interval(ray)
                    .map(|(enter, _)| enter)
                    .filter(|enter| *enter < nearest)
            };
            let (left, right) = (index + 1, node.first);
            let children = match (enter(left), enter(right)) {
                (Some(a), Some(b)) if a <= b => [Some((right, b)), Some((left, a))],
                (a, b) => [a.map(|a| (left, a)), b.map(|b| (right, b))],
            };
            for child in children.into_iter().flatten() {
                stack[depth] = child;
                depth += 1;
            }
        }
        best
    }
}

/// Builds the node over `solids[first..end]` and everything below it.
fn build(nodes: &mut Vec<Node>, solids: &mut [Solid], first: usize, end: usize, halve: bool) {
    let part = &mut solids[first..end];
    let index = nodes.len();
    nodes.push(Node { bounds: around(part), first, count: part.len() });
    if part.len() <= LEAF {
        return;
    }
    let left = if halve { halved(part) } else { best_split(part) };
    build(nodes, solids, first, first + left, halve);
    nodes[index].first = nodes.len();
    nodes[index].count = 0;
    build(nodes, solids, first + left, end, halve);
}

/// Sorts so that the lower half along the longest side comes first, and tells how many that are.
fn halved(part: &mut [Solid]) -> usize {
    let bounds = around(part);
    let axis = (bounds.max - bounds.min).imax();
    let left = part.len() / 2;
    part.select_nth_unstable_by(left, |a, b| centre(a, axis).total_cmp(&centre(b, axis)));
    left
}

/// Sorts for the split with the smallest surface area heuristic (Goldsmith and Salmon
/// 1987): a child is visited as often as its surface is large, and then costs as much as it has solids. Floors and walls,
/// which span the whole building, so stay apart from the small things.
fn best_split(part: &mut [Solid]) -> usize {
    let mut best = (0, part.len() / 2);
    let mut least = f64::INFINITY;
    for axis in 0..3 {
        sort_along(part, axis);
        // Surface of everything from each solid on to the right.
        let mut right = vec![0.0; part.len()];
        let mut bounds = part[part.len() - 1].bounds();
        for (surface, solid) in right.iter_mut().zip(part.iter()).rev() {
            bounds = bounds.union(&solid.bounds());
            *surface = bounds.surface();
        }
        let mut bounds = part[0].bounds();
        for left in 1..part.len() {
            bounds = bounds.union(&part[left - 1].bounds());
            let cost = bounds.surface() * left as f64 + right[left] * (part.len() - left) as f64;
            // Keeps the depth within `MAX_DEPTH`.
            let balanced = left * 8 >= part.len() && (part.len() - left) * 8 >= part.len();
            if balanced && cost < least {
                least = cost;
                best = (axis, left);
            }
        }
    }
    let (axis, left) = best;
    sort_along(part, axis);
    left
}

fn sort_along(part: &mut [Solid], axis: usize) {
    part.sort_by(|a, b| centre(a, axis).total_cmp(&centre(b, axis)));
}

/// Twice the middle.
fn centre(solid: &Solid, axis: usize) -> f64 {
    let bounds = solid.bounds();
    bounds.min[axis] + bounds.max[axis]
}

fn around(part: &[Solid]) -> Bounds {
    part.iter().skip(1).fold(part[0].bounds(), |all, solid| all.union(&solid.bounds()))
}

#[cfg(test)]
mod tests {
    use evac_geometry::nalgebra::Vector3;

    use super::super::material::Material;
    use super::*;
    use crate::random::Random;

    #[test]
    fn the_tree_finds_the_same_nearest_hit_as_testing_every_box() {
        compare(300, 2.0, 2000);
    }

    #[test]
    fn a_tree_of_very_many_small_boxes_does_too() {
        compare(MANY + 1000, 0.8, 300);
    }

    fn compare(count: usize, largest: f64, rays: usize) {
        let mut random = Random::new(11, 0);
        let mut within = |low: f64, high: f64| random.within(low, high);
        let solids: Vec<Solid> = (0..count)
            .map(|_| {
                let centre = [within(-20.0, 20.0), within(-20.0, 20.0), within(-3.0, 3.0)];
                let size = [within(0.05, largest), within(0.05, largest), within(0.05, largest)];
                Solid::turned(centre, size, within(0.0, 180.0), Material::Metal)
            })
            .collect();
        let tree = Bvh::new(solids.clone());
        let mut hits = 0;
        for _ in 0..rays {
            let origin = Vector3::new(within(-20.0, 20.0), within(-20.0, 20.0), within(-3.0, 3.0));
            let direction = Vector3::new(within(-1.0, 1.0), within(-1.0, 1.0), within(-0.3, 0.3)).normalize();
            let ray = Ray::new(origin, direction);
            let all = solids
                .iter()
                .filter_map(|solid| solid.hit(&ray, f64::INFINITY))
                .fold(f64::INFINITY, f64::min);
            let found = tree.cast(&ray, f64::INFINITY).map_or(f64::INFINITY, |(range, _)| range);
            assert_eq!(all, found);
            hits += usize::from(found.is_finite());
        }
        assert!(hits > rays / 4, "{hits} hits are too few to prove anything");
    }
}

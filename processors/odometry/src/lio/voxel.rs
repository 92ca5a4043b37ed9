//! Names of voxels. Each level's edge is half of that of the level before, so the voxel of the finest one says all.

use evac_geometry::nalgebra::Vector3;

/// Edges of the levels, metres, coarse to fine. Large planes with thousands of hits come first in the match: their
/// normals are exact to 1e-4 rad, so a blank wall pulls nothing sideways.
pub(crate) const EDGES: [f64; 4] = [1.6, 0.8, 0.4, 0.2];
const FINEST: usize = EDGES.len() - 1;
const COORDINATE_BITS: u32 = 20;
/// Half of the voxels of the finest level that an axis has names for.
const REACH: i32 = 1 << (COORDINATE_BITS - 1);

/// The voxel of the finest level that a point is in, counted from the corner of all that has a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Voxel([u64; 3]);

impl Voxel {
    /// `None` beyond 100 km.
    pub(crate) fn of(point: &Vector3<f64>) -> Option<Self> {
        let edges = point / EDGES[FINEST];
        // NaN is below nothing.
        let has_name = edges.iter().all(|edge| edge.abs() < f64::from(REACH - 1));
        has_name.then(|| Self([edges.x, edges.y, edges.z].map(|edge| (floor(edge) + REACH) as u64)))
    }

    /// The voxel of `level` that it lies in: the level and three coordinates of 20 bits; never 0.
    pub(crate) fn key(&self, level: usize) -> u64 {
        let [x, y, z] = self.0.map(|coordinate| coordinate >> (FINEST - level));
        let level = 4 | level as u64;
        (((level << COORDINATE_BITS | x) << COORDINATE_BITS | y) << COORDINATE_BITS) | z
    }
}

/// `f64::floor` is a call of a function where the processor is not known to have an instruction for it.
fn floor(x: f64) -> i32 {
    let towards_zero = x as i32;
    towards_zero - i32::from(f64::from(towards_zero) > x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_points_share_the_voxels_whose_borders_do_not_lie_between_them() {
        let keys = |x: f64| {
            let voxel = Voxel::of(&Vector3::new(0.1, x, -0.1)).unwrap();
            [0, 1, 2, 3].map(|level| voxel.key(level))
        };
        for (a, b, shared) in [
            (0.01, 0.19, 4),
            (0.19, 0.21, 3),
            (0.39, 0.41, 2),
            (0.79, 0.81, 1),
            (1.59, 1.61, 0),
            (-0.01, 0.01, 0),
            (-1.59, -0.01, 1),
            (-0.39, -0.19, 3),
            (-0.2, -0.01, 4),
        ] {
            let same = keys(a).iter().zip(keys(b)).take_while(|(a, b)| **a == *b).count();
            assert_eq!(same, shared, "{a} {b}");
        }
    }

    #[test]
    fn every_level_counts_its_edges_as_if_there_were_no_other() {
        for i in -2000..2000 {
            let x = f64::from(i) * 0.037;
            let name = |x: f64, level| Voxel::of(&Vector3::new(x, 0.0, 0.0)).unwrap().key(level);
            for (level, edge) in EDGES.iter().enumerate() {
                let steps = (x / edge).floor();
                assert_eq!(name(x, level), name((steps + 0.5) * edge, level), "{x} {edge}");
            }
        }
    }

    #[test]
    fn what_is_no_place_or_beyond_a_hundred_kilometres_has_no_name() {
        for x in [f64::NAN, f64::INFINITY, -f64::INFINITY, 1.1e5, -1.1e5] {
            assert_eq!(Voxel::of(&Vector3::new(0.0, x, 0.0)), None);
        }
        for x in [1e5, -1e5, 0.0, -0.0] {
            assert_ne!(Voxel::of(&Vector3::new(0.0, x, 0.0)).unwrap().key(0), 0);
        }
    }
}

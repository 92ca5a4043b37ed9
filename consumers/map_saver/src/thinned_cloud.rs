//! The whole walk as one cloud of bounded size.

use evac_formats::cloud::CloudPoint;
use rustc_hash::FxHashSet;

/// Bits of a cell's index along one axis.
const AXIS_BITS: u32 = 21;
/// Cells along one axis.
const SIDE: i64 = 1 << AXIS_BITS;

/// Why a point was not kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dropped {
    /// Another point of its cell is kept already: the thinning itself.
    Thinned,
    /// Not finite, beyond the cells' range, or more points than allowed.
    Rejected,
}

/// The first point of each cell, in the order of arrival.
pub(crate) struct ThinnedCloud {
    cells_per_metre: f64,
    max_points: usize,
    taken: FxHashSet<u64>,
    points: Vec<CloudPoint>,
}

impl ThinnedCloud {
    pub(crate) fn new(voxel_m: f64, max_points: u32) -> Self {
        Self {
            cells_per_metre: 1.0 / voxel_m,
            max_points: max_points as usize,
            taken: FxHashSet::default(),
            points: Vec::new(),
        }
    }

    /// Takes a point in the map frame.
    pub(crate) fn insert(&mut self, point: CloudPoint) -> Result<(), Dropped> {
        let cell = self.cell(&point).ok_or(Dropped::Rejected)?;
        if self.points.len() < self.max_points {
            if !self.taken.insert(cell) {
                return Err(Dropped::Thinned);
            }
            self.points.push(point);
            return Ok(());
        }
        Err(if self.taken.contains(&cell) { Dropped::Thinned } else { Dropped::Rejected })
    }

    pub(crate) fn points(&self) -> &[CloudPoint] {
        &self.points
    }

    fn cell(&self, point: &CloudPoint) -> Option<u64> {
        [point.x, point.y, point.z].into_iter().try_fold(0, |cell, axis| {
            // The cast saturates, and NaN is refused before it.
            let index = (f64::from(axis) * self.cells_per_metre).floor() as i64;
            let index =
                index.checked_add(SIDE / 2).filter(|index| axis.is_finite() && (0..SIDE).contains(index))?;
            Some(cell << AXIS_BITS | index as u64)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f32, y: f32, z: f32) -> CloudPoint {
        CloudPoint { x, y, z, intensity: 0.0 }
    }

    #[test]
    fn each_cell_keeps_its_first_point() {
        let mut cloud = ThinnedCloud::new(0.1, 100);
        assert_eq!(cloud.insert(point(0.01, 0.0, 0.0)), Ok(()));
        assert_eq!(cloud.insert(point(0.09, 0.09, 0.09)), Err(Dropped::Thinned));
        for other in [point(-0.01, 0.0, 0.0), point(0.01, -0.01, 0.0), point(0.01, 0.0, 0.11)] {
            assert_eq!(cloud.insert(other), Ok(()));
        }
        assert_eq!(cloud.points().len(), 4);
        assert_eq!(cloud.points()[0], point(0.01, 0.0, 0.0));
    }

    #[test]
    fn a_full_cloud_rejects_new_cells_only() {
        let mut cloud = ThinnedCloud::new(0.1, 1);
        assert_eq!(cloud.insert(point(0.0, 0.0, 0.0)), Ok(()));
        assert_eq!(cloud.insert(point(0.05, 0.0, 0.0)), Err(Dropped::Thinned));
        assert_eq!(cloud.insert(point(0.5, 0.0, 0.0)), Err(Dropped::Rejected));
    }

    #[test]
    fn what_is_not_finite_or_too_far_is_rejected() {
        let mut cloud = ThinnedCloud::new(0.1, 100);
        for axis in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 2e5, -2e5, f32::MAX] {
            assert_eq!(cloud.insert(point(0.0, axis, 0.0)), Err(Dropped::Rejected), "{axis}");
        }
    }
}

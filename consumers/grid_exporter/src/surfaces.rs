//! The ground's surfaces in a block: floor, table top and platform over each other.

use crate::columns::Columns;
use crate::raster::{Place, Raster};

/// Ground voxels with a gap larger than this between them belong to two surfaces, metres: more than the riser of a stair.
const GAP_M: f64 = 0.25;

/// Finds the median height of each surface of the ground in a block, metres, from the lowest up.
pub(crate) fn find(
    columns: &Columns,
    raster: &Raster,
    block: Place,
    heights: &mut Vec<i32>,
    surfaces: &mut Vec<f64>,
) {
    heights.clear();
    surfaces.clear();
    for cell in raster.cells(block) {
        columns.column(cell).for_each_ground(|height| heights.push(height));
    }
    heights.sort_unstable();
    let gap = (GAP_M / raster.resolution).max(1.0) as i32;
    for surface in heights.chunk_by(|below, above| above - below <= gap) {
        surfaces.extend(surface.get((surface.len() - 1) / 2).map(|height| raster.centre(*height)));
    }
}

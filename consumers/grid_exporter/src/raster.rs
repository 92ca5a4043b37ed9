//! Cells, and the blocks of cells on which the ground is found.

/// Edge of a block, metres.
const BLOCK_M: f64 = 0.5;

/// A place in whole cells, or in whole blocks.
pub(crate) type Place = [i32; 2];

/// How coordinates, cells and blocks lie over each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Raster {
    /// Edge of a cell and a voxel, metres.
    pub(crate) resolution: f64,
    /// Cells along a block.
    pub(crate) block_cells: i32,
}

impl Raster {
    pub(crate) fn new(resolution: f64) -> Self {
        Self { resolution, block_cells: (BLOCK_M / resolution).round().max(1.0) as i32 }
    }

    /// The cell that holds a coordinate.
    pub(crate) fn cell(&self, coordinate: f64) -> i32 {
        (coordinate / self.resolution).floor() as i32
    }

    /// Centre of a cell or voxel, metres.
    pub(crate) fn centre(&self, cell: i32) -> f64 {
        (f64::from(cell) + 0.5) * self.resolution
    }

    /// The block of a cell.
    pub(crate) fn block(&self, cell: Place) -> Place {
        cell.map(|axis| axis.div_euclid(self.block_cells))
    }

    /// The cells of a block.
    pub(crate) fn cells(&self, block: Place) -> impl Iterator<Item = Place> + use<> {
        let size = self.block_cells;
        let [x0, y0] = block.map(|axis| axis * size);
        (y0..y0 + size).flat_map(move |y| (x0..x0 + size).map(move |x| [x, y]))
    }
}

/// The places within `reach` along each axis, itself included.
pub(crate) fn around([x, y]: Place, reach: i32) -> impl Iterator<Item = Place> {
    (-reach..=reach).flat_map(move |dy| (-reach..=reach).map(move |dx| [x + dx, y + dy]))
}

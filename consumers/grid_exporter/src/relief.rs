//! The second layer of a plan: how high the ground is in each cell, and how high one has to step.

use evac_formats::occupancy_grid::OccupancyGrid;

/// Both, row by row from the lowest y as in the plan's grid; NaN where the ground is not known.
#[derive(Debug, Clone)]
pub(crate) struct Relief {
    /// Height of the ground in the map frame, metres, as exact as a voxel.
    pub(crate) ground: Vec<f32>,
    /// Largest difference to the ground of one of the eight neighbours, metres; NaN where none is known.
    pub(crate) step: Vec<f32>,
}

impl Relief {
    /// From the ground in the cells of `grid`.
    pub(crate) fn new(grid: &OccupancyGrid, ground: Vec<f32>) -> Self {
        let (width, height) = (grid.width as usize, grid.height as usize);
        let mut step = vec![f32::NAN; ground.len()];
        for (place, step) in step.iter_mut().enumerate() {
            let (x, y) = (place % width.max(1), place / width.max(1));
            let own = ground.get(place).copied().unwrap_or(f32::NAN);
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            let around = rows.flat_map(|y| {
                let row = ground.get(y * width..(y + 1) * width).unwrap_or_default();
                row.get(x.saturating_sub(1)..(x + 2).min(width)).unwrap_or_default()
            });
            // The cell itself is among them, with a difference of 0.
            let known =
                around.clone().filter(|other| other.is_finite()).count() > usize::from(own.is_finite());
            if own.is_finite() && known {
                *step = around.map(|other| (other - own).abs()).fold(0.0, f32::max);
            }
        }
        Self { ground, step }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kerb_is_a_step_for_the_cells_on_both_sides_and_unknown_ground_is_none() {
        let cells = vec![0; 12];
        let grid = OccupancyGrid { width: 4, height: 3, resolution: 0.1, origin: [0.0; 3], cells };
        let row = [0.0, 0.0, 0.15, f32::NAN];
        let relief = Relief::new(&grid, row.repeat(3));
        for y in 0..3 {
            assert_eq!(relief.step[4 * y..4 * y + 3], [0.0, 0.15, 0.15]);
            assert!(relief.step[4 * y + 3].is_nan());
        }
        let alone = OccupancyGrid { width: 1, height: 1, cells: vec![0], ..grid };
        assert!(Relief::new(&alone, vec![1.0]).step[0].is_nan());
    }
}

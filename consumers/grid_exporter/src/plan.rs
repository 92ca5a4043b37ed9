//! The projection to the XOY plane (paper section 3.1 and 3.2 step 3): non-ground voxels of a height band over the local
//! ground make a cell occupied, seen ground or space seen through makes it free, all else stays unknown.

use evac_formats::occupancy_grid::{FREE, OCCUPIED, OccupancyGrid, UNKNOWN};

use crate::columns::{Column, Columns, Kind};
use crate::config::GridExporterConfig;
use crate::floor::{Area, Floor, cell_of, centre};
use crate::path::Path;

/// Rounding of a height computed from voxel indices, metres.
const ROUNDING_M: f64 = 1e-6;

/// What one column says about its cell.
#[derive(Debug, Clone, Copy, Default)]
struct Evidence {
    /// Occupied voxels in the band.
    occupied: u32,
    /// Whether a person could stand here if nothing is in the way.
    open: bool,
}

/// Projects the columns; keeps its buffers from plan to plan.
pub(crate) struct Projection {
    floor: Floor,
    evidence: Vec<Evidence>,
    cells: Vec<i8>,
    grid: OccupancyGrid,
}

impl Projection {
    pub(crate) fn new() -> Self {
        let grid =
            OccupancyGrid { width: 0, height: 0, resolution: 1.0, origin: [0.0; 3], cells: Vec::new() };
        Self { floor: Floor::default(), evidence: Vec::new(), cells: Vec::new(), grid }
    }

    /// The latest plan.
    pub(crate) fn grid(&self) -> &OccupancyGrid {
        &self.grid
    }

    /// Makes the plan anew; false (and no new plan) where nothing is known at all.
    ///
    /// The plan holds the known cells and the path within `bounds` of the columns, and the configured margin.
    pub(crate) fn update(
        &mut self,
        columns: &Columns,
        path: &Path,
        resolution: f64,
        config: &GridExporterConfig,
    ) -> bool {
        let Some((low, size)) = columns.bounds() else { return false };
        let area = Area { low, size };
        self.floor.update(columns, path, resolution, area, config);
        self.collect_evidence(columns, resolution, area, config);
        self.classify(area, config);
        let Some(known) = self.known(path, resolution, area) else { return false };
        let margin = (config.margin_m / resolution).ceil() as u32;
        self.crop(area, known, margin, resolution);
        true
    }

    fn collect_evidence(
        &mut self,
        columns: &Columns,
        resolution: f64,
        area: Area,
        config: &GridExporterConfig,
    ) {
        self.evidence.clear();
        for (x, y) in cells(area) {
            let column = columns.column(x, y);
            self.evidence.push(evidence(column, self.floor.at(x, y), resolution, config));
        }
    }

    fn classify(&mut self, area: Area, config: &GridExporterConfig) {
        self.cells.clear();
        let [width, height] = area.size.map(|cells| cells as usize);
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let own = self.evidence.get(y * width + x).copied().unwrap_or_default();
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            let columns = x.saturating_sub(1)..(x + 2).min(width);
            let around = || -> u32 {
                let each = rows.flat_map(|row| columns.clone().map(move |column| row * width + column));
                each.filter_map(|at| self.evidence.get(at)).map(|evidence| evidence.occupied).sum()
            };
            self.cells.push(if own.occupied > 0 && around() >= config.min_occupied_voxels {
                OCCUPIED
            } else if own.open {
                FREE
            } else {
                UNKNOWN
            });
        }
    }

    /// Smallest and largest offset into `area` of what the plan must show.
    fn known(&self, path: &Path, resolution: f64, area: Area) -> Option<[[u32; 2]; 2]> {
        let mut bounds: Option<[[u32; 2]; 2]> = None;
        let mut include = |x: u32, y: u32| {
            let [low, high] = bounds.get_or_insert([[x, y], [x, y]]);
            *low = [low[0].min(x), low[1].min(y)];
            *high = [high[0].max(x), high[1].max(y)];
        };
        for (row, y) in self.cells.chunks_exact(area.size[0] as usize).zip(0..) {
            let known = |cell: &i8| *cell != UNKNOWN;
            if let (Some(first), Some(last)) = (row.iter().position(known), row.iter().rposition(known)) {
                include(first as u32, y);
                include(last as u32, y);
            }
        }
        for [x, y, _] in path.points() {
            let offset = |axis: usize, value: f64| {
                let cell = i64::from(cell_of(value, resolution)) - i64::from(area.low[axis]);
                u32::try_from(cell).ok().filter(|cell| *cell < area.size[axis])
            };
            if let (Some(x), Some(y)) = (offset(0, x), offset(1, y)) {
                include(x, y);
            }
        }
        bounds
    }

    fn crop(&mut self, area: Area, [low, high]: [[u32; 2]; 2], margin: u32, resolution: f64) {
        let [width, height] = [0, 1].map(|axis: usize| high[axis] - low[axis] + 1 + 2 * margin);
        let grid = &mut self.grid;
        (grid.width, grid.height, grid.resolution) = (width, height, resolution);
        let corner = |axis: usize| {
            let cell = i64::from(area.low[axis]) + i64::from(low[axis]) - i64::from(margin);
            cell as f64 * resolution
        };
        grid.origin = [corner(0), corner(1), 0.0];
        grid.cells.clear();
        grid.cells.resize(width as usize * height as usize, UNKNOWN);
        let rows = self.cells.chunks_exact(area.size[0] as usize).skip(low[1] as usize);
        let targets = grid.cells.chunks_exact_mut(width as usize).skip(margin as usize);
        for (row, target) in rows.take((high[1] - low[1] + 1) as usize).zip(targets) {
            let known = row.get(low[0] as usize..=high[0] as usize).unwrap_or_default();
            let margin = margin as usize;
            if let Some(target) = target.get_mut(margin..margin + known.len()) {
                target.copy_from_slice(known);
            }
        }
    }
}

/// All cells of an area, row by row from the lowest y.
fn cells(area: Area) -> impl Iterator<Item = (i32, i32)> {
    let Area { low: [x0, y0], size: [width, height] } = area;
    (y0..y0 + height as i32).flat_map(move |y| (x0..x0 + width as i32).map(move |x| (x, y)))
}

fn evidence(column: Column<'_>, floor: f64, resolution: f64, config: &GridExporterConfig) -> Evidence {
    // Voxels whose centres lie in the band.
    let [low, high] = config.band_m;
    let first = ((floor + low - ROUNDING_M) / resolution - 0.5).ceil() as i32;
    let last = ((floor + high + ROUNDING_M) / resolution - 0.5).floor() as i32;
    let (mut ground, mut below) = (false, false);
    column.for_each_ground(|cell| {
        let above = centre(cell, resolution) - floor;
        ground |= above.abs() <= config.max_step_m;
        below |= above < -config.max_step_m;
    });
    // Space over a ground that lies a storey deeper (a gallery's void, a platform's edge) is no way.
    let drop = below && !ground;
    let seen_through = || column.count(Kind::Free, first, last) >= config.min_free_voxels;
    Evidence {
        occupied: column.count(Kind::Occupied, first, last),
        open: !drop && (ground || seen_through()),
    }
}

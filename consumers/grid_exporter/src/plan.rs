//! The projection to the XOY plane (paper section 3.1 and 3.2 step 3): non-ground voxels of a height band over the local
//! ground make a cell occupied; seen ground, space seen through down to near the floor, or having been walked on makes it
//! free; all else stays unknown, and so does what speaks for both too faintly.

use evac_formats::occupancy_grid::{FREE, OCCUPIED, OccupancyGrid, UNKNOWN};

use crate::columns::{Column, Columns, Kind};
use crate::config::GridExporterConfig;
use crate::floor::{Area, Floor, cell_of, centre};
use crate::path::Path;

/// Rounding of a height computed from voxel indices, metres.
const ROUNDING_M: f64 = 1e-6;

/// Space seen this far below the floor is a hole in it, metres: more than a riser, and than the heights of one floor differ
/// between two walks over it.
const DROP_M: f64 = 0.3;
/// How far down such space is looked for, metres: rays that pass over an edge leave some of it close below.
const DROP_DEPTH_M: f64 = 1.5;

/// The path says this far to each side that there is a floor, metres: half the width of who carries the sensor.
const WALKED_M: f64 = 0.25;
/// What is lower than this on a stair that was climbed was stepped on, metres: a riser and the slope below its tread.
const STEPPED_OVER_M: f64 = 0.4;

/// What the path and the column say about a cell.
#[derive(Debug, Clone, Copy, Default)]
struct Evidence {
    /// Whether the path passes.
    walked: bool,
    /// Whether it climbs as it passes.
    climbed: bool,
    /// Occupied voxels in the band.
    occupied: u32,
    /// Whether a person could stand here if nothing is in the way.
    open: bool,
}

impl Evidence {
    /// Adds what a column says to what the path has said.
    fn weigh(&mut self, column: Column<'_>, floor: f64, resolution: f64, config: &GridExporterConfig) {
        let count = |kind: Kind, low: f64, high: f64| {
            // Voxels whose centres lie between.
            let first = ((floor + low - ROUNDING_M) / resolution - 0.5).ceil() as i32;
            let last = ((floor + high + ROUNDING_M) / resolution - 0.5).floor() as i32;
            column.count(kind, first, last)
        };
        let [low, high] = config.band_m;
        let (mut ground, mut deeper, mut raised) = (false, false, 0);
        column.for_each_ground(|cell| {
            let above = centre(cell, resolution) - floor;
            ground |= above.abs() <= config.max_step_m;
            deeper |= above < -config.max_step_m;
            // A top that is too high to step on, however even it is.
            raised += u32::from(above > config.max_step_m && (low..=high).contains(&above));
        });
        // Space that was seen down to near the floor, and no farther: there is none over a gallery's void, a platform's
        // edge or a stair that leads down, and what is seen over a table says nothing of what is below.
        let seen_through = || {
            // Coarse voxels: at least one, and no more than there are; the floor's own one is no hole.
            let near_floor = config.seen_down_to_m.max(low + resolution);
            let voxels = ((near_floor - low + ROUNDING_M) / resolution) as u32;
            count(Kind::Free, low, near_floor) >= config.min_free_voxels.min(voxels)
                && !deeper
                && count(Kind::Free, -DROP_DEPTH_M, -DROP_M.max(resolution)) == 0
        };
        // On a stair that was climbed the next step is no obstacle.
        let low = if self.climbed { low.max(STEPPED_OVER_M) } else { low };
        self.occupied = count(Kind::Occupied, low, high) + raised;
        self.open = self.walked || ground || seen_through();
    }
}

/// Projects the columns; keeps its buffers from plan to plan.
pub(crate) struct Projection {
    floor: Floor,
    evidence: Vec<Evidence>,
    cells: Vec<i8>,
    /// Indices of the cells to close.
    gaps: Vec<usize>,
    grid: OccupancyGrid,
}

impl Projection {
    pub(crate) fn new() -> Self {
        let grid =
            OccupancyGrid { width: 0, height: 0, resolution: 1.0, origin: [0.0; 3], cells: Vec::new() };
        Self { floor: Floor::default(), evidence: Vec::new(), cells: Vec::new(), gaps: Vec::new(), grid }
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
        self.mark_walked(path, resolution, area);
        self.collect_evidence(columns, resolution, area, config);
        self.classify(area, config);
        self.close_gaps(area, config.min_gap_m, resolution);
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
        for ((x, y), evidence) in cells(area).zip(&mut self.evidence) {
            evidence.weigh(columns.column(x, y), self.floor.at(x, y), resolution, config);
        }
    }

    /// Starts anew, with what the path tells.
    fn mark_walked(&mut self, path: &Path, resolution: f64, area: Area) {
        self.evidence.clear();
        self.evidence.resize(area.size[0] as usize * area.size[1] as usize, Evidence::default());
        let reach = (WALKED_M / resolution).floor() as i32;
        for point in path.points().filter(|point| self.floor.carries(*point, resolution)) {
            let stair = self.floor.is_stair(point, resolution);
            let [x, y] = [0, 1].map(|axis: usize| cell_of(point[axis], resolution) - area.low[axis]);
            for (dx, dy) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy))) {
                let index = area.index(x + dx, y + dy).filter(|_| dx * dx + dy * dy <= reach * reach);
                if let Some(evidence) = index.and_then(|index| self.evidence.get_mut(index)) {
                    evidence.walked = true;
                    evidence.climbed |= stair;
                }
            }
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
            } else if own.occupied == 0 && own.open {
                FREE
            } else {
                UNKNOWN
            });
        }
    }

    /// Closes the free cells between two obstacles in a row or a column that are less than `min_gap` metres apart.
    fn close_gaps(&mut self, area: Area, min_gap: f64, resolution: f64) {
        let [width, height] = area.size.map(|cells| cells as usize);
        self.gaps.clear();
        let rows = (0..height).map(|row| (row * width, 1, width));
        let columns = (0..width).map(|column| (column, width, height));
        for (first, stride, count) in rows.chain(columns) {
            // Free cells since the last obstacle; `None` where something else lies between.
            let mut run = None;
            for at in (0..count).map(|i| first + i * stride) {
                match self.cells.get(at) {
                    Some(&OCCUPIED) => {
                        let free = run.unwrap_or(0);
                        if free as f64 * resolution < min_gap - ROUNDING_M {
                            self.gaps.extend((1..=free).map(|i| at - i * stride));
                        }
                        run = Some(0);
                    }
                    Some(&FREE) => run = run.map(|free| free + 1),
                    _ => run = None,
                }
            }
        }
        for at in &self.gaps {
            if let Some(cell) = self.cells.get_mut(*at) {
                *cell = OCCUPIED;
            }
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

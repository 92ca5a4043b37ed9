//! The cells of one storey's plan, kept tile by tile, and what becomes of them when the evidence for some of them changes.

use evac_formats::occupancy_grid::{FREE, OCCUPIED, OccupancyGrid, UNKNOWN};
use rustc_hash::{FxHashMap, FxHashSet};

use crate::GridExporterConfig;
use crate::columns::{Marks, SIDE, index, marked_cells, tile_of};
use crate::evidence::Evidence;
use crate::raster::{Place, around};

/// Rounding of a width in cells, metres.
const ROUNDING_M: f64 = 1e-6;
/// Cells of a tile.
const CELLS: usize = (SIDE * SIDE) as usize;

/// 8 x 8 cells.
#[derive(Clone)]
struct Tile {
    evidence: [Evidence; CELLS],
    /// By the evidence for a cell and its neighbours.
    states: [i8; CELLS],
    /// With the narrow gaps closed.
    cells: [i8; CELLS],
}

const NOTHING: Evidence = Evidence { occupied: 0, open: false, ground: f32::NAN };
const EMPTY: Tile = Tile { evidence: [NOTHING; CELLS], states: [UNKNOWN; CELLS], cells: [UNKNOWN; CELLS] };

/// The plan of one storey.
pub(crate) struct Sheet {
    tiles: FxHashMap<Place, Tile>,
    resolution: f64,
    min_occupied: u32,
    /// Free cells between two obstacles that are a gap for nobody.
    gap: i32,
    line: Vec<i8>,
}

impl Sheet {
    pub(crate) fn new(resolution: f64, config: &GridExporterConfig) -> Self {
        // As octomap_server: every voxel counts, and every gap stays.
        let (min_gap, min_occupied) = match config.fixed_z_m {
            Some(_) => (0.0, 1),
            None => (config.min_gap_m, config.min_occupied_voxels),
        };
        let gap = ((min_gap - ROUNDING_M) / resolution).ceil() as i32 - 1;
        Self { tiles: FxHashMap::default(), resolution, min_occupied, gap: gap.max(0), line: Vec::new() }
    }

    /// Weighs the marked cells anew, and draws what follows from it; true where a cell or a height has changed.
    pub(crate) fn update(&mut self, marks: &Marks, mut weigh: impl FnMut(Place) -> Evidence) -> bool {
        let (mut to_judge, mut changed) = (FxHashSet::default(), false);
        for (at, mask) in marks {
            let tile = self.tiles.entry(*at).or_insert(EMPTY);
            let mut weighs_other = false;
            for cell in marked_cells(*at, *mask) {
                let (new, old) = (weigh(cell), &mut tile.evidence[index(cell)]);
                weighs_other |= (new.occupied, new.open) != (old.occupied, old.open);
                changed |= new.ground.to_bits() != old.ground.to_bits();
                *old = new;
            }
            if weighs_other {
                to_judge.extend(around(*at, 1));
            }
        }
        let mut to_close = FxHashSet::default();
        for at in to_judge {
            if self.judge(at) {
                let reach = self.gap / SIDE + i32::from(self.gap % SIDE > 0);
                let [x, y] = at;
                to_close.extend((-reach..=reach).flat_map(|d| [[x + d, y], [x, y + d]]));
            }
        }
        for at in to_close {
            changed |= self.close_gaps(at);
        }
        changed
    }

    /// Finds the states of a tile's cells; true where one has changed.
    fn judge(&mut self, at: Place) -> bool {
        const WIDE: i32 = SIDE + 2;
        let Some(tile) = self.tiles.get(&at) else { return false };
        let [x0, y0] = at.map(|axis| axis * SIDE - 1);
        let mut occupied = [0_u8; (WIDE * WIDE) as usize];
        for near in around(at, 1) {
            let Some(tile) = self.tiles.get(&near) else { continue };
            for cell in marked_cells(near, u64::MAX) {
                let (x, y) = (cell[0] - x0, cell[1] - y0);
                if (0..WIDE).contains(&x) && (0..WIDE).contains(&y) {
                    occupied[(y * WIDE + x) as usize] = tile.evidence[index(cell)].occupied;
                }
            }
        }
        let mut states = [UNKNOWN; CELLS];
        for (place, state) in states.iter_mut().enumerate() {
            let (x, y) = (place as i32 % SIDE, place as i32 / SIDE);
            let around = || -> u32 {
                let rows = (y..y + 3).flat_map(|y| (x..x + 3).map(move |x| (y * WIDE + x) as usize));
                rows.map(|at| u32::from(occupied[at])).sum()
            };
            let own = &tile.evidence[place];
            *state = if own.occupied > 0 && around() >= self.min_occupied {
                OCCUPIED
            } else if own.occupied == 0 && own.open {
                FREE
            } else {
                UNKNOWN
            };
        }
        let changed = states != tile.states;
        if let Some(tile) = self.tiles.get_mut(&at).filter(|_| changed) {
            tile.states = states;
        }
        changed
    }

    /// Closes the free cells of a tile that lie in too narrow a gap between two obstacles in a row or a column; true where a
    /// cell has changed.
    fn close_gaps(&mut self, at: Place) -> bool {
        let Some(tile) = self.tiles.get(&at) else { return false };
        let mut cells = tile.states;
        if self.gap > 0 && cells.contains(&FREE) {
            let mut line = std::mem::take(&mut self.line);
            for across in 0..SIDE {
                for along_x in [true, false] {
                    self.read_line(at, across, along_x, &mut line);
                    for along in 0..SIDE {
                        let place = if along_x { across * SIDE + along } else { along * SIDE + across };
                        if self.is_gap(&line, (along + self.gap) as usize) {
                            cells[place as usize] = OCCUPIED;
                        }
                    }
                }
            }
            self.line = line;
        }
        let changed = cells != tile.cells;
        if let Some(tile) = self.tiles.get_mut(&at).filter(|_| changed) {
            tile.cells = cells;
        }
        changed
    }

    /// The states along a row or a column of a tile, and as far beyond it as a gap can reach.
    fn read_line(&self, at: Place, across: i32, along_x: bool, line: &mut Vec<i8>) {
        line.clear();
        let [x0, y0] = at.map(|axis| axis * SIDE);
        let mut known: Option<(Place, Option<&Tile>)> = None;
        for along in -self.gap..SIDE + self.gap {
            let cell = if along_x { [x0 + along, y0 + across] } else { [x0 + across, y0 + along] };
            let tile = match known {
                Some((at, tile)) if at == tile_of(cell) => tile,
                _ => self.tiles.get(&tile_of(cell)),
            };
            known = Some((tile_of(cell), tile));
            line.push(tile.map_or(UNKNOWN, |tile| tile.states[index(cell)]));
        }
    }

    /// Whether a cell of a line lies in a gap.
    fn is_gap(&self, line: &[i8], at: usize) -> bool {
        let reach = self.gap as usize;
        if line.get(at) != Some(&FREE) {
            return false;
        }
        // Cells to the nearest that is not free, where that is an obstacle.
        let ended = |cells: &mut dyn Iterator<Item = &i8>| {
            let end = cells.take(reach).enumerate().find(|(_, state)| **state != FREE);
            end.filter(|(_, state)| **state == OCCUPIED).map(|(free, _)| free)
        };
        let before = ended(&mut line.iter().take(at).rev());
        let after = before.and_then(|_| ended(&mut line.iter().skip(at + 1)));
        before.zip(after).is_some_and(|(before, after)| before + after < reach)
    }

    /// The plan with all cells that are known and a border of `margin` metres; false and an unchanged grid where none is.
    pub(crate) fn compose(&self, margin: f64, grid: &mut OccupancyGrid) -> bool {
        let Some((low, high)) = self.bounds() else { return false };
        let margin = (margin / self.resolution).ceil() as i32;
        let [x0, y0] = low.map(|axis| axis - margin);
        let [width, height] = [0, 1].map(|axis: usize| (high[axis] - low[axis] + 1 + 2 * margin) as usize);
        (grid.width, grid.height, grid.resolution) = (width as u32, height as u32, self.resolution);
        grid.origin = [f64::from(x0) * self.resolution, f64::from(y0) * self.resolution, 0.0];
        grid.cells.clear();
        grid.cells.resize(width * height, UNKNOWN);
        for (at, tile) in &self.tiles {
            for (cell, state) in
                marked_cells(*at, u64::MAX).zip(tile.cells).filter(|(_, state)| *state != UNKNOWN)
            {
                let (x, y) = ((cell[0] - x0) as usize, (cell[1] - y0) as usize);
                if let Some(target) = grid.cells.get_mut(y * width + x) {
                    *target = state;
                }
            }
        }
        true
    }

    /// Height of the ground in the cells of a composed grid, metres; NaN where it is not known, and on obstacles.
    pub(crate) fn ground(&self, grid: &OccupancyGrid) -> Vec<f32> {
        let [x0, y0] = [0, 1].map(|axis: usize| (grid.origin[axis] / grid.resolution).round() as i32);
        let mut ground = vec![f32::NAN; grid.cells.len()];
        for (at, tile) in &self.tiles {
            for (cell, evidence) in marked_cells(*at, u64::MAX).zip(&tile.evidence) {
                let (x, y) = (i64::from(cell[0] - x0), i64::from(cell[1] - y0));
                let inside =
                    (0..i64::from(grid.width)).contains(&x) && (0..i64::from(grid.height)).contains(&y);
                let place = (y * i64::from(grid.width) + x) as usize;
                if inside && grid.cells.get(place) != Some(&OCCUPIED) {
                    ground[place] = evidence.ground;
                }
            }
        }
        ground
    }

    /// Lowest and highest known cell.
    fn bounds(&self) -> Option<(Place, Place)> {
        let mut bounds: Option<(Place, Place)> = None;
        for (at, tile) in &self.tiles {
            for (cell, _) in
                marked_cells(*at, u64::MAX).zip(tile.cells).filter(|(_, state)| *state != UNKNOWN)
            {
                let (low, high) = bounds.get_or_insert((cell, cell));
                for axis in 0..2 {
                    low[axis] = low[axis].min(cell[axis]);
                    high[axis] = high[axis].max(cell[axis]);
                }
            }
        }
        bounds
    }
}

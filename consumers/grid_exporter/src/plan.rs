//! The projection to the XOY plane (paper section 3.1 and 3.2 step 3), storey by storey, kept up to date.
//!
//! Everything here follows from the columns and the walk alone, in whatever order they came: a projection that has followed a
//! thousand updates equals a new one, cell by cell. An update costs what it has changed:
//!
//! 1. surfaces of the ground in blocks with new ground or path ([`crate::surfaces`]);
//! 2. the sensor's height and the storeys ([`crate::sensor_height`], [`crate::storeys`]); where one of them changes, which is seldom,
//!    everything is projected anew;
//! 3. which surfaces are reached ([`crate::reach`]), and from that the floor of each storey ([`crate::floor`]);
//! 4. evidence for the cells with new voxels, path or floor ([`crate::evidence`]), and what they and their neighbours become
//!    ([`crate::sheet`]).

use std::ops::Range;

use evac_formats::occupancy_grid::OccupancyGrid;
use rustc_hash::FxHashSet;

use crate::GridExporterConfig;
use crate::columns::{Columns, Marks, SIDE, mark, marked_cells};
use crate::evidence::{Footing, weigh};
use crate::floor::{Floor, Sources};
use crate::raster::{Place, Raster};
use crate::reach::Reach;
use crate::sensor_height::SensorHeight;
use crate::sheet::Sheet;
use crate::storeys;
use crate::surfaces;
use crate::walk::Walk;

/// A storey and its plan.
struct Storey {
    floor: Floor,
    sheet: Sheet,
}

/// What has changed since the last update.
#[derive(Default)]
struct Changes {
    cells: Marks,
    ground: Marks,
    blocks: FxHashSet<Place>,
}

/// The plans of all storeys.
pub(crate) struct Projection {
    raster: Raster,
    reach: Reach,
    heights: SensorHeight,
    /// Metres.
    sensor_height: f64,
    /// Bins of the walk's histogram.
    bins: Vec<i32>,
    storeys: Vec<Storey>,
    /// Nothing is projected yet.
    fresh: bool,
    // Kept from update to update for their memory.
    voxels: Vec<i32>,
    levels: Vec<f64>,
}

impl Projection {
    pub(crate) fn new(raster: Raster, config: &GridExporterConfig) -> Self {
        Self {
            raster,
            reach: Reach::new(config.max_step_m),
            heights: SensorHeight::default(),
            sensor_height: config.sensor_height_m,
            bins: Vec::new(),
            storeys: Vec::new(),
            fresh: true,
            voxels: Vec::new(),
            levels: Vec::new(),
        }
    }

    /// Projects what has changed in the columns and the walk since the last update; true where a plan has changed.
    pub(crate) fn update(
        &mut self,
        columns: &mut Columns,
        walk: &mut Walk,
        config: &GridExporterConfig,
    ) -> bool {
        let mut changes = if self.fresh { all(columns, walk) } else { news(columns, walk) };
        if changes.cells.is_empty() && changes.blocks.is_empty() && !self.fresh {
            return false;
        }
        self.fresh = false;
        changes.blocks.extend(blocks_of(&changes.ground, self.raster));
        self.find_surfaces(columns, walk, &changes.blocks);

        let sensor_height = self.heights.median().unwrap_or(config.sensor_height_m);
        let mut bins = storeys::find(&walk.heights());
        if config.fixed_z_m.is_some() {
            bins.truncate(1);
        }
        let mut changed = false;
        if sensor_height != self.sensor_height || bins != self.bins {
            (self.sensor_height, self.bins) = (sensor_height, bins);
            self.storeys = self.found_storeys(walk, config);
            changes = all(columns, walk);
            changes.blocks.extend(blocks_of(&changes.ground, self.raster));
            changed = true;
        }

        let under_path = |block: Place| walk.visits(block).map(|visit| visit.height - sensor_height);
        let touched = self.reach.settle(&changes.blocks, under_path);
        let sources = Sources { raster: self.raster, walk, reach: &self.reach, sensor_height };
        for storey in &mut self.storeys {
            changed |= storey.update(&touched, &changes.cells, columns, &sources, config);
        }
        changed
    }

    fn find_surfaces(&mut self, columns: &Columns, walk: &Walk, blocks: &FxHashSet<Place>) {
        for block in blocks {
            surfaces::find(columns, &self.raster, *block, &mut self.voxels, &mut self.levels);
            self.reach.set(*block, &self.levels);
            self.heights.update(*block, walk.visits(*block).map(|visit| visit.height), &self.levels);
        }
    }

    fn found_storeys(&self, walk: &Walk, config: &GridExporterConfig) -> Vec<Storey> {
        let level = |bin: &i32| walk.bin_height(*bin) - self.sensor_height;
        let storey = |bin: &i32| {
            let below = self.bins.iter().filter(|other| *other < bin).max().map(level);
            let above = self.bins.iter().filter(|other| *other > bin).min().map(level);
            let span = Range {
                start: below.map_or(f64::NEG_INFINITY, |level| level + config.max_step_m),
                end: above.map_or(f64::INFINITY, |level| level - config.max_step_m),
            };
            Storey {
                floor: Floor::new(level(bin), span, config.max_step_m),
                sheet: Sheet::new(self.raster.resolution, config),
            }
        };
        self.bins.iter().map(storey).collect()
    }

    /// How many storeys there are; they count in the order in which they were entered.
    pub(crate) fn storeys(&self) -> usize {
        self.storeys.len()
    }

    /// Height of a storey's floor, metres.
    pub(crate) fn height(&self, storey: usize) -> f64 {
        self.storeys.get(storey).map_or(0.0, |storey| storey.floor.storey())
    }

    /// The storey whose floor is nearest below a sensor at this height, metres.
    pub(crate) fn storey_at(&self, sensor: f64) -> usize {
        let off = |storey: &usize| (sensor - self.sensor_height - self.height(*storey)).abs();
        (0..self.storeys()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or_default()
    }

    /// Whether the path at this height is drawn on a storey's plan.
    pub(crate) fn shows(&self, storey: usize, sensor: f64) -> bool {
        self.storeys.get(storey).is_some_and(|storey| storey.floor.spans(sensor - self.sensor_height))
    }

    /// The plan of a storey into `grid`; false, and the grid as it was, where nothing of it is known.
    pub(crate) fn compose(&self, storey: usize, margin: f64, grid: &mut OccupancyGrid) -> bool {
        self.storeys.get(storey).is_some_and(|storey| storey.sheet.compose(margin, grid))
    }

    /// Heights of the ground in the cells of a composed plan, metres; NaN where unknown.
    pub(crate) fn ground(&self, storey: usize, grid: &OccupancyGrid) -> Vec<f32> {
        self.storeys.get(storey).map(|storey| storey.sheet.ground(grid)).unwrap_or_default()
    }
}

impl Storey {
    fn update(
        &mut self,
        blocks: &FxHashSet<Place>,
        cells: &Marks,
        columns: &Columns,
        sources: &Sources<'_>,
        config: &GridExporterConfig,
    ) -> bool {
        let raster = sources.raster;
        let mut marks = cells.clone();
        let moved = self.floor.update(blocks, sources);
        for cell in moved.iter().flat_map(|block| raster.cells(*block)) {
            if columns.allows(cell) {
                mark(&mut marks, cell);
            }
        }
        for at in marks.keys() {
            let low = at.map(|axis| axis * SIDE);
            self.floor.prepare(low, low.map(|axis| axis + SIDE - 1), raster);
        }
        let floor = &self.floor;
        self.sheet.update(&marks, |cell| {
            let height = floor.at(cell, raster);
            let climbed = floor.is_stair(raster.block(cell));
            let mut footing = Footing { floor: height, walked: false, climbed };
            for pass in sources.walk.passes(cell) {
                if floor.carries(pass, height, sources.sensor_height) {
                    footing.walked = true;
                    footing.climbed |= floor.is_stair(pass.block);
                }
            }
            weigh(columns.column(cell), footing, raster, config)
        })
    }
}

/// Everything.
fn all(columns: &mut Columns, walk: &mut Walk) -> Changes {
    let _ = news(columns, walk);
    let mut changes = Changes::default();
    columns.all(&mut changes.cells, &mut changes.ground);
    let (blocks, cells) = walk.all();
    changes.add_walk(blocks, cells, columns);
    changes
}

/// What is new since the last call.
fn news(columns: &mut Columns, walk: &mut Walk) -> Changes {
    let mut changes = Changes::default();
    columns.take_changes(&mut changes.cells, &mut changes.ground);
    let (blocks, cells) = walk.take_changes();
    changes.add_walk(blocks, cells, columns);
    changes
}

impl Changes {
    fn add_walk(&mut self, blocks: Vec<Place>, cells: Vec<Place>, columns: &Columns) {
        self.blocks.extend(blocks);
        for cell in cells.into_iter().filter(|cell| columns.allows(*cell)) {
            mark(&mut self.cells, cell);
        }
    }
}

/// The blocks of marked cells.
fn blocks_of(marks: &Marks, raster: Raster) -> FxHashSet<Place> {
    let cells = marks.iter().flat_map(|(at, mask)| marked_cells(*at, *mask));
    cells.map(|cell| raster.block(cell)).collect()
}

#[cfg(test)]
mod tests;

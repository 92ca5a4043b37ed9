//! How high the ground is, everywhere in the plan.
//!
//! The walk starts on a storey. From there the ground's height is followed block by block, nearest blocks first: a block
//! takes the median of its ground voxels within one step of the height of the block it was reached from; without any,
//! that of the sensor's path less the sensor's height; without that, the height it was reached from. So each place has
//! one height, slopes and slow drift are followed, and a storey above or below that is seen later in the walk, up a
//! stairwell for example, changes nothing where this one is.

use std::collections::VecDeque;

use crate::columns::Columns;
use crate::config::GridExporterConfig;
use crate::path::Path;

/// Edge of a block, metres.
const BLOCK_M: f64 = 0.5;
/// Path points that are looked at to measure the sensor's height.
const HEIGHT_SAMPLES: usize = 2000;
/// Path points with ground below that suffice to trust the measured height: half a metre of way.
const MIN_HEIGHT_SAMPLES: usize = 5;
/// Ground within this distance of the path is below the sensor, metres.
const BELOW_M: f64 = 0.3;
/// The sensor is held between these heights, metres.
const SENSOR_HEIGHTS_M: [f64; 2] = [0.15, 3.0];

/// A rectangle of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Area {
    pub(crate) low: [i32; 2],
    pub(crate) size: [u32; 2],
}

/// Height of the ground by block.
#[derive(Default)]
pub(crate) struct Floor {
    block_cells: i32,
    low: [i32; 2],
    size: [i32; 2],
    levels: Vec<f64>,
    visited: Vec<bool>,
    queue: VecDeque<[i32; 2]>,
    samples: Vec<f64>,
    path_levels: Vec<(usize, f64)>,
}

/// Centre of voxel `cell`, metres.
pub(crate) fn centre(cell: i32, resolution: f64) -> f64 {
    (f64::from(cell) + 0.5) * resolution
}

/// The cell that holds a coordinate.
pub(crate) fn cell_of(coordinate: f64, resolution: f64) -> i32 {
    (coordinate / resolution).floor() as i32
}

impl Floor {
    /// Finds the ground in `area`.
    pub(crate) fn update(
        &mut self,
        columns: &Columns,
        path: &Path,
        resolution: f64,
        area: Area,
        config: &GridExporterConfig,
    ) {
        self.block_cells = (BLOCK_M / resolution).round().max(1.0) as i32;
        self.low = area.low.map(|cell| cell.div_euclid(self.block_cells));
        self.size = [0, 1].map(|axis: usize| {
            let last = area.low[axis] + area.size[axis] as i32 - 1;
            last.div_euclid(self.block_cells) - self.low[axis] + 1
        });
        let blocks = self.size.iter().product::<i32>() as usize;
        self.levels.clear();
        self.levels.resize(blocks, 0.0);
        self.visited.clear();
        self.visited.resize(blocks, false);

        let sensor_height = self.sensor_height(columns, path, resolution).unwrap_or(config.sensor_height_m);
        self.collect_path_levels(path, resolution, sensor_height);
        let start = path.points().next();
        let (block, level) = match start {
            Some([x, y, z]) => (self.block_at(x, y, resolution), z - sensor_height),
            None => ([0, 0], -sensor_height),
        };
        self.spread(columns, resolution, block, level, config.max_step_m);
    }

    /// Height of the ground under a cell, metres.
    pub(crate) fn at(&self, x: i32, y: i32) -> f64 {
        let block = [x, y].map(|cell| cell.div_euclid(self.block_cells));
        let index = self.index([block[0] - self.low[0], block[1] - self.low[1]]);
        index.and_then(|index| self.levels.get(index)).copied().unwrap_or_default()
    }

    /// Median height of the path above the ground seen below it.
    fn sensor_height(&mut self, columns: &Columns, path: &Path, resolution: f64) -> Option<f64> {
        let reach = (BELOW_M / resolution).floor() as i32;
        let every = path.points().count() / HEIGHT_SAMPLES + 1;
        self.samples.clear();
        for [x, y, z] in path.points().step_by(every) {
            let (cx, cy) = (cell_of(x, resolution), cell_of(y, resolution));
            let mut height = f64::INFINITY;
            for (dx, dy) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy))) {
                columns.column(cx + dx, cy + dy).for_each_ground(|ground| {
                    let above = z - centre(ground, resolution);
                    if above >= SENSOR_HEIGHTS_M[0] {
                        height = height.min(above);
                    }
                });
            }
            if height <= SENSOR_HEIGHTS_M[1] {
                self.samples.push(height);
            }
        }
        if self.samples.len() < MIN_HEIGHT_SAMPLES { None } else { median(&mut self.samples) }
    }

    fn collect_path_levels(&mut self, path: &Path, resolution: f64, sensor_height: f64) {
        let mut levels = std::mem::take(&mut self.path_levels);
        levels.clear();
        levels.extend(
            path.points().filter_map(|[x, y, z]| {
                Some((self.index(self.block_at(x, y, resolution))?, z - sensor_height))
            }),
        );
        levels.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        self.path_levels = levels;
    }

    /// Breadth first from the start's block.
    fn spread(&mut self, columns: &Columns, resolution: f64, start: [i32; 2], level: f64, max_step: f64) {
        self.queue.clear();
        self.visit(columns, resolution, start, level, max_step);
        while let Some(block) = self.queue.pop_front() {
            let level = self.index(block).and_then(|index| self.levels.get(index)).copied().unwrap_or(level);
            for [dx, dy] in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
                self.visit(columns, resolution, [block[0] + dx, block[1] + dy], level, max_step);
            }
        }
    }

    fn visit(&mut self, columns: &Columns, resolution: f64, block: [i32; 2], inherited: f64, max_step: f64) {
        let Some(index) = self.index(block) else { return };
        let Some(visited) = self.visited.get_mut(index) else { return };
        if std::mem::replace(visited, true) {
            return;
        }
        let near = |height: f64| (height - inherited).abs() <= max_step;
        self.samples.clear();
        let (x0, y0) =
            ((self.low[0] + block[0]) * self.block_cells, (self.low[1] + block[1]) * self.block_cells);
        for (y, x) in
            (y0..y0 + self.block_cells).flat_map(|y| (x0..x0 + self.block_cells).map(move |x| (y, x)))
        {
            columns.column(x, y).for_each_ground(|ground| {
                let height = centre(ground, resolution);
                if near(height) {
                    self.samples.push(height);
                }
            });
        }
        if self.samples.is_empty() {
            let from = self.path_levels.partition_point(|(at, _)| *at < index);
            let here = self.path_levels.iter().skip(from).take_while(|(at, _)| *at == index);
            self.samples.extend(here.map(|(_, height)| *height).filter(|height| near(*height)));
        }
        let level = median(&mut self.samples).unwrap_or(inherited);
        if let Some(slot) = self.levels.get_mut(index) {
            *slot = level;
        }
        self.queue.push_back(block);
    }

    fn block_at(&self, x: f64, y: f64, resolution: f64) -> [i32; 2] {
        let [bx, by] = [x, y].map(|axis| cell_of(axis, resolution).div_euclid(self.block_cells));
        [bx - self.low[0], by - self.low[1]]
    }

    fn index(&self, [x, y]: [i32; 2]) -> Option<usize> {
        let inside = (0..self.size[0]).contains(&x) && (0..self.size[1]).contains(&y);
        inside.then(|| y as usize * self.size[0] as usize + x as usize)
    }
}

/// The lower median; `None` of nothing.
fn median(samples: &mut [f64]) -> Option<f64> {
    let middle = samples.len().checked_sub(1)? / 2;
    Some(*samples.select_nth_unstable_by(middle, f64::total_cmp).1)
}

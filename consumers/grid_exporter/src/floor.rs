//! How high the ground is, everywhere in the plan.
//!
//! First the sensor's path is followed in time: each block it enters gets the height of the ground seen there within one
//! step below the sensor, or without any the path's height less the sensor's. Where the path comes to lie a storey above
//! or below what it has passed close by, it has left the plan's storey and counts no more until it is back on it. From
//! these blocks the height spreads, nearest first, to blocks with ground within one step of the block they are reached
//! from, which take its median; then to the walls beside them, and to all others from blocks of the storey's main height:
//! these without ground of their own take the height of the block they are reached from. So each place has one height, stairs, slopes and slow drift are followed, and a storey above or
//! below that is seen later changes nothing where this one is.

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
/// A path this much above or below ...
const STOREY_GAP_M: f64 = 2.0;
/// ... itself within this distance is on another storey, metres: stairs up to 45 degrees rise less.
const STOREY_REACH_M: f64 = 2.0;
/// How far the ground may lie from the path less the measured height of the sensor, metres: a step and the gait.
const TREAD_M: f64 = 0.25;
/// A path that changes its height by more than this within a block is on a stair, metres: the gait does not.
const CLIMB_M: f64 = 0.12;
/// How far a height reaches over blocks without ground before the storey's main height is taken, metres.
const BESIDE_M: f64 = 1.0;
/// The sensor is held between these heights, metres.
const SENSOR_HEIGHTS_M: [f64; 2] = [0.15, 3.0];

/// A rectangle of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Area {
    pub(crate) low: [i32; 2],
    pub(crate) size: [u32; 2],
}

impl Area {
    /// Place of a cell in the rows from the lowest y on, by its offset.
    pub(crate) fn index(&self, x: i32, y: i32) -> Option<usize> {
        let [width, height] = self.size.map(|cells| cells as i32);
        let inside = (0..width).contains(&x) && (0..height).contains(&y);
        inside.then(|| y as usize * width as usize + x as usize)
    }
}

/// What heights are taken from.
struct Ground<'a> {
    columns: &'a Columns,
    resolution: f64,
    reach: f64,
}

/// What a block without ground of its own does.
#[derive(Debug, Clone, Copy)]
enum Otherwise {
    Wait,
    TakeExpected,
}

/// The path within one block, without leaving it: the floor's heights below it.
#[derive(Debug, Clone, Copy)]
struct Stay {
    block: [i32; 2],
    sum: f64,
    count: f64,
    low: f64,
    high: f64,
}

impl Stay {
    fn new(block: [i32; 2], floor: f64) -> Self {
        Self { block, sum: floor, count: 1.0, low: floor, high: floor }
    }

    fn add(&mut self, floor: f64) {
        self.sum += floor;
        self.count += 1.0;
        self.low = self.low.min(floor);
        self.high = self.high.max(floor);
    }
}

/// Height of the ground by block.
#[derive(Default)]
pub(crate) struct Floor {
    block_cells: i32,
    max_step: f64,
    sensor_height: f64,
    low: [i32; 2],
    size: [i32; 2],
    levels: Vec<Option<f64>>,
    /// Blocks in which the path climbs.
    stairs: Vec<bool>,
    /// Blocks that have their height, in the order in which they got it.
    assigned: Vec<[i32; 2]>,
    samples: Vec<f64>,
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
        self.levels.resize(blocks, None);
        self.stairs.clear();
        self.stairs.resize(blocks, false);

        self.max_step = config.max_step_m;
        let measured = self.sensor_height(columns, path, resolution);
        let sensor_height = measured.unwrap_or(config.sensor_height_m);
        self.sensor_height = sensor_height;
        // With a measured height the path tells a tread from the floor below the stair.
        let reach = if measured.is_some() { TREAD_M.min(self.max_step) } else { self.max_step };
        self.assigned.clear();
        self.follow(&Ground { columns, resolution, reach }, path, sensor_height);
        let ground = Ground { columns, resolution, reach: self.max_step };
        if self.assigned.is_empty() {
            // The path lies outside of all that was seen.
            let start = path.points().next().map_or(0.0, |[_, _, z]| z);
            self.assign(&ground, [0, 0], start - sensor_height, Otherwise::TakeExpected);
        }
        self.spread(&ground, Otherwise::Wait, |_| true);
        self.widen(&ground);
        let main = self.main_level();
        self.spread(&ground, Otherwise::TakeExpected, |level| (level - main).abs() <= config.max_step_m);
        // What is left lies behind blocks of another height.
        self.spread(&ground, Otherwise::TakeExpected, |_| true);
    }

    /// Height of the ground under a cell, metres: between the centres of blocks of one storey it changes steadily.
    pub(crate) fn at(&self, x: i32, y: i32) -> f64 {
        let size = f64::from(self.block_cells);
        let [u, v] = [(x, self.low[0]), (y, self.low[1])]
            .map(|(cell, low)| (f64::from(cell) + 0.5) / size - f64::from(low) - 0.5);
        let own = self.level([u.round() as i32, v.round() as i32]).unwrap_or_default();
        let (x0, y0) = (u.floor() as i32, v.floor() as i32);
        let (share_x, share_y) = (u - u.floor(), v - v.floor());
        let corner = |dx: i32, dy: i32| {
            let level = self.level([x0 + dx, y0 + dy]);
            level.filter(|level| (level - own).abs() <= self.max_step).unwrap_or(own)
        };
        let along_x = |dy: i32| corner(0, dy) * (1.0 - share_x) + corner(1, dy) * share_x;
        along_x(0) * (1.0 - share_y) + along_x(1) * share_y
    }

    /// Whether whoever carried the sensor at this place in metres stood on this floor.
    pub(crate) fn carries(&self, [x, y, z]: [f64; 3], resolution: f64) -> bool {
        let floor = self.at(cell_of(x, resolution), cell_of(y, resolution));
        (z - self.sensor_height - floor).abs() <= self.max_step
    }

    /// Whether the path climbs at this place in metres.
    pub(crate) fn is_stair(&self, [x, y, _]: [f64; 3], resolution: f64) -> bool {
        let stair = self.index(self.block_at(x, y, resolution)).and_then(|index| self.stairs.get(index));
        stair.copied().unwrap_or_default()
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

    /// Gives the path's blocks their heights, in the order of time.
    fn follow(&mut self, ground: &Ground<'_>, path: &Path, sensor_height: f64) {
        let mut on_storey = true;
        let mut stay: Option<Stay> = None;
        for [x, y, z] in path.points() {
            let block = self.block_at(x, y, ground.resolution);
            let floor = z - sensor_height;
            match &mut stay {
                Some(stay) if stay.block == block => stay.add(floor),
                _ => {
                    self.settle(ground, stay, &mut on_storey);
                    stay = Some(Stay::new(block, floor));
                }
            }
        }
        self.settle(ground, stay, &mut on_storey);
    }

    fn settle(&mut self, ground: &Ground<'_>, stay: Option<Stay>, on_storey: &mut bool) {
        let Some(stay) = stay else { return };
        let (block, floor) = (stay.block, stay.sum / stay.count);
        match self.level(block) {
            Some(level) if *on_storey => *on_storey = (floor - level).abs() <= STOREY_GAP_M,
            Some(level) => *on_storey = (floor - level).abs() <= self.max_step,
            None if *on_storey => {
                *on_storey = self.is_one_storey(block, floor, ground.resolution);
                if *on_storey && stay.high - stay.low > CLIMB_M {
                    // The ground seen on a stair is that before its first step.
                    self.put(block, floor);
                    if let Some(stair) = self.index(block).and_then(|index| self.stairs.get_mut(index)) {
                        *stair = true;
                    }
                } else if *on_storey {
                    self.assign(ground, block, floor, Otherwise::TakeExpected);
                }
            }
            None => {}
        }
    }

    /// Whether no block close by has its ground a storey higher or deeper.
    fn is_one_storey(&self, [x, y]: [i32; 2], floor: f64, resolution: f64) -> bool {
        let reach = (STOREY_REACH_M / (f64::from(self.block_cells) * resolution)).round() as i32;
        let mut around = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| [x + dx, y + dy]));
        around.all(|block| self.level(block).is_none_or(|level| (floor - level).abs() <= STOREY_GAP_M))
    }

    /// Breadth first from all blocks that have a height which `may_spread`.
    fn spread(&mut self, ground: &Ground<'_>, otherwise: Otherwise, may_spread: impl Fn(f64) -> bool) {
        let mut next = 0;
        while let Some(block) = self.assigned.get(next).copied() {
            next += 1;
            if self.level(block).is_some_and(&may_spread) {
                self.assign_neighbours(ground, block, otherwise);
            }
        }
    }

    /// Gives the height of each block to those within [`BESIDE_M`] that have none: walls, and the sides of stairs.
    fn widen(&mut self, ground: &Ground<'_>) {
        for _ in 0..(BESIDE_M / BLOCK_M) as u32 {
            for at in 0..self.assigned.len() {
                if let Some(block) = self.assigned.get(at).copied() {
                    self.assign_neighbours(ground, block, Otherwise::TakeExpected);
                }
            }
        }
    }

    fn assign_neighbours(&mut self, ground: &Ground<'_>, [x, y]: [i32; 2], otherwise: Otherwise) {
        let level = self.level([x, y]).unwrap_or_default();
        for [dx, dy] in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
            self.assign(ground, [x + dx, y + dy], level, otherwise);
        }
    }

    /// The median height of all blocks that have one: that of the storey, not of a stair's landing.
    fn main_level(&mut self) -> f64 {
        self.samples.clear();
        self.samples.extend(self.levels.iter().flatten());
        median(&mut self.samples).unwrap_or_default()
    }

    /// Gives a block that has none its height: the median of its ground within a step of `expected`.
    fn assign(&mut self, ground: &Ground<'_>, block: [i32; 2], expected: f64, otherwise: Otherwise) {
        if self.index(block).is_none() || self.level(block).is_some() {
            return;
        }
        let [x0, y0] = [0, 1].map(|axis: usize| (self.low[axis] + block[axis]) * self.block_cells);
        self.samples.clear();
        for (y, x) in
            (y0..y0 + self.block_cells).flat_map(|y| (x0..x0 + self.block_cells).map(move |x| (y, x)))
        {
            ground.columns.column(x, y).for_each_ground(|cell| {
                let height = centre(cell, ground.resolution);
                if (height - expected).abs() <= ground.reach {
                    self.samples.push(height);
                }
            });
        }
        let level = match (median(&mut self.samples), otherwise) {
            (Some(median), _) => median,
            (None, Otherwise::TakeExpected) => expected,
            (None, Otherwise::Wait) => return,
        };
        self.put(block, level);
    }

    fn put(&mut self, block: [i32; 2], level: f64) {
        let slot = self.index(block).and_then(|index| self.levels.get_mut(index));
        if let Some(slot) = slot {
            *slot = Some(level);
            self.assigned.push(block);
        }
    }

    /// The height of a block; `None` outside, and where it has none yet.
    fn level(&self, block: [i32; 2]) -> Option<f64> {
        self.levels.get(self.index(block)?).copied()?
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

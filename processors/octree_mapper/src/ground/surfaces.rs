//! Cells of the xy plane and the surfaces found in each.

use super::moments::{Moments, Plane};
use crate::GroundConfig;

/// No index.
pub(super) const NONE: u32 = u32::MAX;
/// Largest coordinate that is looked at, metres; beyond it `f32` resolves 6 cm only.
const LAST_COORDINATE_M: f32 = 1e6;

/// One point in the order of cells and height.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Entry {
    cell: u64,
    /// Bits of z, mapped so that their order is that of z.
    height: u32,
    pub(super) index: u32,
}

/// A cell of the xy plane with at least one point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    pub(super) key: u64,
    /// Its points, as a range of the entries.
    pub(super) entries: [u32; 2],
    /// Its surfaces from the lowest up, as a range of the surfaces.
    pub(super) surfaces: [u32; 2],
    /// The eight cells around, [`NONE`] where there is no point.
    pub(super) neighbours: [u32; 8],
}

/// The lowest slab of points above a gap in one cell: of a floor, but also of a wall's foot or a cupboard.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surface {
    pub(super) cell: u32,
    pub(super) moments: Moments,
    pub(super) mean: [f64; 3],
    /// Whether points go on above it without a gap: the foot of something, of no use for planes.
    pub(super) foot: bool,
    /// Plane through this surface and those beside it, where it is horizontal.
    pub(super) plane: Option<Plane>,
    /// Index of its patch or [`NONE`].
    pub(super) patch: u32,
}

impl Surface {
    pub(super) fn new(cell: u32) -> Self {
        Self { cell, moments: Moments::default(), mean: [0.0; 3], foot: false, plane: None, patch: NONE }
    }
}

/// Points sorted into cells and surfaces. Buffers are reused.
#[derive(Debug, Default)]
pub(super) struct Surfaces {
    /// Subtracted from all coordinates, metres: keeps squares small in geographic coordinates.
    pub(super) origin: [f64; 3],
    pub(super) entries: Vec<Entry>,
    pub(super) cells: Vec<Cell>,
    pub(super) list: Vec<Surface>,
}

impl Surfaces {
    pub(super) fn with_capacity(points: usize) -> Self {
        Self {
            origin: [0.0; 3],
            entries: Vec::with_capacity(points),
            cells: Vec::with_capacity(points),
            list: Vec::with_capacity(points),
        }
    }

    /// Sorts the points and finds each cell's surfaces and their local planes.
    pub(super) fn find(&mut self, config: &GroundConfig, points: &[[f32; 3]], origin: [f64; 3]) {
        self.origin = origin;
        self.sort(config, points);
        self.split(config, points);
        self.complete(config);
    }

    /// Finds means, neighbours and local planes where cells and moments are known.
    pub(super) fn complete(&mut self, config: &GroundConfig) {
        for surface in &mut self.list {
            surface.mean = surface.moments.mean();
        }
        self.connect();
        let slope = config.max_tilt_deg.to_radians().tan();
        for i in 0..self.list.len() {
            self.list[i].plane = self.local_plane(config, slope, i);
        }
    }

    /// Adds a cell whose points are not held; cells come in the order of their keys.
    pub(super) fn push_cell(&mut self, key: u64, surfaces: [u32; 2]) {
        self.cells.push(Cell { key, entries: [0; 2], surfaces, neighbours: [NONE; 8] });
    }

    /// A point relative to the origin.
    pub(super) fn relative(&self, point: [f32; 3]) -> [f64; 3] {
        std::array::from_fn(|k| f64::from(point[k]) - self.origin[k])
    }

    /// Surfaces of a cell.
    pub(super) fn of_cell(&self, cell: u32) -> impl Iterator<Item = &Surface> {
        let [from, to] = self.cells[cell as usize].surfaces;
        self.list[from as usize..to as usize].iter()
    }

    /// Surfaces of the eight cells around a cell.
    pub(super) fn around(&self, cell: u32) -> impl Iterator<Item = &Surface> {
        let neighbours = self.cells[cell as usize].neighbours;
        neighbours.into_iter().filter(|cell| *cell != NONE).flat_map(|cell| self.of_cell(cell))
    }

    fn sort(&mut self, config: &GroundConfig, points: &[[f32; 3]]) {
        self.entries.clear();
        for (index, point) in points.iter().enumerate() {
            // Written so that NaN is left out too.
            if point.iter().all(|x| x.abs() <= LAST_COORDINATE_M) {
                let [x, y, _] = self.relative(*point);
                let cell = key(column(x / config.cell_m), column(y / config.cell_m));
                self.entries.push(Entry { cell, height: ordered(point[2]), index: index as u32 });
            }
        }
        self.entries.sort_unstable();
    }

    fn split(&mut self, config: &GroundConfig, points: &[[f32; 3]]) {
        self.cells.clear();
        self.list.clear();
        let mut first = 0;
        for run in self.entries.chunk_by(|a, b| a.cell == b.cell) {
            let cell = self.cells.len() as u32;
            let surfaces = self.list.len() as u32;
            let origin = self.origin;
            // Sorted by height: a surface starts above every gap and takes the points of its thickness.
            let (mut bottom, mut last) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
            for entry in run {
                let point = points[entry.index as usize];
                let point: [f64; 3] = std::array::from_fn(|k| f64::from(point[k]) - origin[k]);
                if point[2] - last > config.thickness_m + config.step_m {
                    bottom = point[2];
                    self.list.push(Surface::new(cell));
                }
                last = point[2];
                if let Some(surface) = self.list.last_mut() {
                    if last <= bottom + config.thickness_m {
                        surface.moments.add(point);
                    }
                    surface.foot = last > bottom + 1.5 * config.thickness_m;
                }
            }
            let range = |from: u32, len: usize| [from, from + len as u32];
            self.cells.push(Cell {
                key: run[0].cell,
                entries: range(first, run.len()),
                surfaces: [surfaces, self.list.len() as u32],
                neighbours: [NONE; 8],
            });
            first += run.len() as u32;
        }
    }

    /// Finds every cell's neighbours by a binary search in each of the two other rows.
    fn connect(&mut self) {
        for i in 0..self.cells.len() {
            let (x, y) = columns(self.cells[i].key);
            let mut neighbours = [NONE; 8];
            let mut slot = 0;
            for row in [y.wrapping_sub(1), y, y.wrapping_add(1)] {
                let start = match row == y {
                    true => i.saturating_sub(1),
                    false => self.cells.partition_point(|cell| cell.key < key(x.wrapping_sub(1), row)),
                };
                for (j, cell) in self.cells.iter().enumerate().skip(start).take(3) {
                    let (cx, cy) = columns(cell.key);
                    if j != i && cy == row && cx.abs_diff(x) <= 1 {
                        neighbours[slot] = j as u32;
                        slot += 1;
                    }
                }
            }
            self.cells[i].neighbours = neighbours;
        }
    }

    /// Plane through a surface and those beside it at about its height; `None` unless it is supported and tilted by `slope`
    /// at most.
    fn local_plane(&self, config: &GroundConfig, slope: f64, i: usize) -> Option<Plane> {
        let surface = &self.list[i];
        if surface.foot {
            return None;
        }
        let mut moments = surface.moments;
        for other in self.around(surface.cell).filter(|other| !other.foot) {
            let [x, y, z] = std::array::from_fn(|k| (other.mean[k] - surface.mean[k]).abs());
            if z <= slope * (x * x + y * y).sqrt() + config.step_m {
                moments.merge(&other.moments, 1.0);
            }
        }
        // One cell's width of support across: a strip narrower than that has no tilt of its own.
        if moments.n < f64::from(config.min_points) || moments.extents()[0] < config.cell_m {
            return None;
        }
        moments.plane().filter(|plane| plane.tilt() <= slope && plane.rms <= 0.5 * config.thickness_m)
    }
}

pub(super) fn column(value: f64) -> u32 {
    // Biased so that the order of the unsigned numbers is that of the signed ones.
    (value.floor() as i32 as u32) ^ 0x8000_0000
}

pub(super) fn key(x: u32, y: u32) -> u64 {
    u64::from(y) << 32 | u64::from(x)
}

pub(super) fn columns(key: u64) -> (u32, u32) {
    (key as u32, (key >> 32) as u32)
}

/// Maps a float to an integer of the same order.
fn ordered(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 1 { !bits } else { bits | 0x8000_0000 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_of_floats_keep_their_order() {
        let values = [f32::MIN, -2.5, -1e-9, 0.0, 1e-9, 0.1, 77.0];
        assert!(values.is_sorted_by(|a, b| ordered(*a) < ordered(*b)));
    }

    #[test]
    fn every_cell_knows_the_cells_around_it() {
        let config = GroundConfig::default();
        let points: Vec<[f32; 3]> = (-3..3)
            .flat_map(|x| (-3..3).map(move |y| [0.25 * x as f32 + 0.1, 0.25 * y as f32 + 0.1, 0.0]))
            .collect();
        let mut surfaces = Surfaces::default();
        surfaces.find(&config, &points, [0.0; 3]);
        let counts = surfaces.cells.iter().map(|c| c.neighbours.iter().filter(|n| **n != NONE).count());
        let mut counts: Vec<usize> = counts.collect();
        counts.sort_unstable();
        assert_eq!(counts, [[3; 4].as_slice(), &[5; 16], &[8; 16]].concat());
    }

    #[test]
    fn a_cell_with_floor_and_ceiling_has_two_surfaces_and_a_wall_only_its_foot() {
        let config = GroundConfig::default();
        let mut surfaces = Surfaces::default();
        surfaces.find(&config, &[[0.1, 0.1, -1.0], [0.1, 0.1, 1.5], [0.1, 0.2, -0.98]], [0.0; 3]);
        assert_eq!(surfaces.list.iter().map(|s| s.moments.n).collect::<Vec<_>>(), [2.0, 1.0]);
        let wall: Vec<[f32; 3]> = (0..100).map(|i| [0.1, 0.1, 0.02 * i as f32]).collect();
        surfaces.find(&config, &wall, [0.0; 3]);
        assert_eq!(surfaces.list.len(), 1);
        assert_eq!(surfaces.list[0].moments.n, 5.0);
    }
}

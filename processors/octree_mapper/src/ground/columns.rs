//! Surfaces of a cloud that is read twice and not held: counts by slices of columns, then moments by surface.

use std::mem;

use rustc_hash::FxHashMap;

use super::patch::{self, Patch};
use super::surfaces::{Cell, NONE, Surface, Surfaces, column, columns, key};
use super::{Plane, planes_of, thickness_above};
use crate::GroundConfig;

/// Slices of a surface's thickness: 2 cm at the usual 8 cm.
const SLICES: f64 = 4.0;
/// Slices of one piece of a column.
const PIECE: i32 = 32;
/// A slice with less than this share of the fullest one near is stray points, not the bottom of a surface.
const STRAYS: u32 = 20;
/// Points above a surface, by its own number, from which it is the foot of something that goes on upwards.
const FOOT_SHARE: f64 = 0.125;
/// How far above a surface such points are looked for, metres.
const FOOT_M: f64 = 0.25;
/// More than heights of planes are rounded by within a million metres.
const ROUNDING_M: f64 = 1e-6;

/// Numbers of points by cell of the xy plane and slice of height.
#[derive(Debug)]
pub(crate) struct GroundColumns {
    config: GroundConfig,
    origin: Option<[f64; 3]>,
    slice_m: f64,
    index: FxHashMap<[i32; 3], u32>,
    pieces: Vec<[u16; PIECE as usize]>,
    last: Option<([i32; 3], u32)>,
}

impl GroundColumns {
    pub(crate) fn new(config: GroundConfig) -> Self {
        Self {
            config,
            origin: None,
            slice_m: config.thickness_m / SLICES,
            index: FxHashMap::default(),
            pieces: Vec::new(),
            last: None,
        }
    }

    pub(crate) fn pieces(&self) -> usize {
        self.pieces.len()
    }

    /// Counts a point, which is finite and within a million metres.
    pub(crate) fn add(&mut self, point: [f32; 3]) {
        // Whole cells and slices from zero, so that they are the same in any order of the points.
        let edges = [self.config.cell_m, self.config.cell_m, self.slice_m];
        let whole = |axis: usize| (f64::from(point[axis]) / edges[axis]).floor() * edges[axis];
        let origin = *self.origin.get_or_insert_with(|| std::array::from_fn(whole));
        let [x, y, z] = std::array::from_fn(|axis| f64::from(point[axis]) - origin[axis]);
        let slice = (z / self.slice_m).floor() as i32;
        let cell = |value: f64| (value / self.config.cell_m).floor() as i32;
        let at = [cell(x), cell(y), slice.div_euclid(PIECE)];
        let number = match self.last {
            Some((last, number)) if last == at => number,
            _ => {
                let next = self.pieces.len() as u32;
                let number = *self.index.entry(at).or_insert(next);
                if number == next {
                    self.pieces.push([0; PIECE as usize]);
                }
                self.last = Some((at, number));
                number
            }
        };
        let count = &mut self.pieces[number as usize][slice.rem_euclid(PIECE) as usize];
        *count = count.saturating_add(1);
    }

    /// Finds the surfaces, all points being counted.
    pub(crate) fn surfaces(mut self) -> CloudGround {
        let mut order: Vec<([i32; 3], u32)> = mem::take(&mut self.index).into_iter().collect();
        // Cells in the order that neighbours are searched in: rows of y, in them x.
        order.sort_unstable_by_key(|([x, y, z], _)| [*y, *x, *z]);
        let mut ground = CloudGround {
            surfaces: Surfaces::default(),
            slabs: Vec::new(),
            cells: FxHashMap::default(),
            last: None,
            planes: Vec::new(),
            heights: Vec::new(),
            slice_m: self.slice_m,
            config: self.config,
        };
        ground.surfaces.origin = self.origin.unwrap_or_default();
        let mut slices = Vec::new();
        for cell in order.chunk_by(|([ax, ay, _], _), ([bx, by, _], _)| (ax, ay) == (bx, by)) {
            slices.clear();
            for ([_, _, z], number) in cell {
                let counts =
                    self.pieces[*number as usize].iter().enumerate().filter(|(_, count)| **count > 0);
                slices.extend(counts.map(|(at, count)| (z * PIECE + at as i32, u32::from(*count))));
            }
            if let Some(([x, y, _], _)) = cell.first() {
                ground.add_cell([*x, *y], &slices);
            }
        }
        ground
    }
}

/// The ground of a cloud: surfaces that are given their points once more, and then judged.
#[derive(Debug)]
pub(crate) struct CloudGround {
    config: GroundConfig,
    slice_m: f64,
    surfaces: Surfaces,
    /// By surface, its first and last slice.
    slabs: Vec<[i32; 2]>,
    /// Cell by its key.
    cells: FxHashMap<u64, u32>,
    /// The cell that was asked for last, by its key: a cloud's points come place by place.
    last: Option<(u64, Option<u32>)>,
    /// By surface, the plane of the ground that it is part of.
    planes: Vec<Option<Plane>>,
    /// By cell, heights outside which no point of it is ground.
    heights: Vec<[f64; 2]>,
}

impl CloudGround {
    /// Splits a column's slices, lowest first, at gaps; each part's lowest slab is a surface.
    fn add_cell(&mut self, [x, y]: [i32; 2], slices: &[(i32, u32)]) {
        let in_slices = |metres: f64| (metres / self.slice_m).round() as i32;
        let gap = in_slices(self.config.thickness_m + self.config.step_m);
        let thickness = in_slices(self.config.thickness_m);
        let reach = in_slices(FOOT_M);
        let cell = self.surfaces.cells.len() as u32;
        let first = self.surfaces.list.len() as u32;
        for part in slices.chunk_by(|(below, _), (above, _)| above - below <= gap) {
            let sum = |from: i32, to: i32| -> u32 {
                part.iter().filter(|(at, _)| (from..=to).contains(at)).map(|(_, count)| count).sum()
            };
            let near = part
                .iter()
                .take_while(|(at, _)| part.first().is_some_and(|(low, _)| at - low <= 2 * thickness));
            let fullest = near.map(|(_, count)| *count).max().unwrap_or(0);
            let Some((bottom, _)) = part.iter().find(|(_, count)| count * STRAYS > fullest) else { continue };
            let top = bottom + thickness;
            let above = sum(top + 1, top + reach);
            let foot = f64::from(above) > FOOT_SHARE * f64::from(sum(*bottom, top));
            self.surfaces.list.push(Surface { foot, ..Surface::new(cell) });
            self.slabs.push([*bottom, top]);
        }
        let key = key(biased(x), biased(y));
        self.surfaces.push_cell(key, [first, self.surfaces.list.len() as u32]);
        self.cells.insert(key, cell);
    }

    fn cell(&mut self, [x, y, _]: [f64; 3]) -> Option<usize> {
        let key = key(column(x / self.config.cell_m), column(y / self.config.cell_m));
        let cell = match self.last {
            Some((last, cell)) if last == key => cell,
            _ => self.cells.get(&key).copied(),
        };
        self.last = Some((key, cell));
        cell.map(|cell| cell as usize)
    }

    /// Gives a surface one of its points.
    pub(crate) fn add(&mut self, point: [f32; 3]) {
        let point = self.surfaces.relative(point);
        let Some(cell) = self.cell(point) else { return };
        let slice = (point[2] / self.slice_m).floor() as i32;
        let [from, to] = self.surfaces.cells[cell].surfaces.map(|at| at as usize);
        let slabs = self.slabs[from..to].iter().position(|[low, high]| (*low..=*high).contains(&slice));
        if let Some(surface) = slabs.and_then(|at| self.surfaces.list.get_mut(from + at)) {
            surface.moments.add(point);
        }
    }

    /// Finds the patches that are ground, all points being given.
    pub(crate) fn judge(&mut self) {
        let (mut patches, mut stack): (Vec<Patch>, _) = (Vec::new(), Vec::new());
        self.surfaces.complete(&self.config);
        patch::join(&self.config, &mut self.surfaces, &mut patches, &mut stack);
        patch::judge(&self.config, &self.surfaces, &mut patches, None);
        planes_of(&self.surfaces, &patches, &mut self.planes);
        self.heights = self.surfaces.cells.iter().map(|cell| self.heights(cell)).collect();
    }

    /// Lowest and highest a point of a cell can be ground: planes are extreme at the cell's corners.
    fn heights(&self, cell: &Cell) -> [f64; 2] {
        let corner = |at: u32, beyond: i32| f64::from(unbiased(at) + beyond) * self.config.cell_m;
        let (x, y) = columns(cell.key);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let around = cell.neighbours.iter().filter(|near| **near != NONE);
        let ranges = around.map(|near| self.surfaces.cells[*near as usize].surfaces);
        for [from, to] in ranges.chain([cell.surfaces]) {
            for plane in self.planes[from as usize..to as usize].iter().flatten() {
                for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    let height = plane.height(corner(x, i), corner(y, j));
                    (low, high) = (low.min(height), high.max(height));
                }
            }
        }
        [low - self.config.thickness_m - ROUNDING_M, high + self.config.thickness_m + ROUNDING_M]
    }

    /// Whether a point lies near the ground's plane in its own or a neighbouring cell.
    pub(crate) fn is_ground(&mut self, point: [f32; 3]) -> bool {
        let point = self.surfaces.relative(point);
        let Some(cell) = self.cell(point) else { return false };
        let [low, high] = self.heights[cell];
        if !(low..=high).contains(&point[2]) {
            return false;
        }
        let cell = &self.surfaces.cells[cell];
        let [first, end] = cell.surfaces;
        let own = &self.surfaces.list[first as usize..end as usize];
        let heights = -self.config.thickness_m..=thickness_above(&self.config, own);
        let on = |[from, to]: [u32; 2]| {
            let mut planes = self.planes[from as usize..to as usize].iter().flatten();
            planes.any(|plane| heights.contains(&(point[2] - plane.height(point[0], point[1]))))
        };
        on(cell.surfaces)
            || cell
                .neighbours
                .iter()
                .filter(|near| **near != NONE)
                .any(|near| on(self.surfaces.cells[*near as usize].surfaces))
    }
}

/// As [`column`] biases.
fn biased(cell: i32) -> u32 {
    cell as u32 ^ 0x8000_0000
}

fn unbiased(column: u32) -> i32 {
    (column ^ 0x8000_0000) as i32
}

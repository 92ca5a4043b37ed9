//! How many points lie in each small cube, and what that alone says about the points in it.

use rustc_hash::FxHashMap;

/// Cubes along a block's edge.
pub(super) const SIDE: i32 = 4;
/// Cubes that a search sphere reaches beyond its own, along an axis: the edge is the radius over the root of 3.
pub(super) const REACH: i32 = 2;

/// Index of a cube along each axis.
pub(super) type Cube = [i32; 3];

/// What the counts say about all points of a cube.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Class {
    /// Enough others in the cube itself, of which every two are within the radius.
    Inlier,
    /// Too few in all the cubes that the sphere can reach.
    Outlier,
    /// Depends on where in their cubes the points lie.
    Undecided,
}

/// Counts up to 255 by cube, in blocks of 4 x 4 x 4: a surface takes about 5 bytes a cube, a lonely point 100.
#[derive(Debug)]
pub(super) struct Counts {
    per_metre: f64,
    enough: u8,
    index: FxHashMap<[i32; 3], u32>,
    blocks: Vec<[u8; 64]>,
    /// By block, of each cube one bit of "inlier" and one of "outlier".
    classes: Vec<[u64; 2]>,
    /// The block of the last point.
    last: Option<([i32; 3], u32)>,
}

impl Counts {
    /// Cubes for spheres of `radius` metres, of which a point needs `min_neighbours` others to be an inlier.
    pub(super) fn new(radius: f64, min_neighbours: u8) -> Self {
        Self {
            // A hair smaller, so that rounding makes no pair in one cube farther apart than the radius.
            per_metre: 3f64.sqrt() / radius * (1.0 + 1e-6),
            enough: min_neighbours,
            index: FxHashMap::default(),
            blocks: Vec::new(),
            classes: Vec::new(),
            last: None,
        }
    }

    pub(super) fn blocks(&self) -> usize {
        self.blocks.len()
    }

    pub(super) fn cube(&self, point: [f32; 3]) -> Cube {
        point.map(|axis| (f64::from(axis) * self.per_metre).floor() as i32)
    }

    pub(super) fn add(&mut self, point: [f32; 3]) {
        let (block, slot) = split(self.cube(point));
        let number = match self.last {
            Some((last, number)) if last == block => number,
            _ => {
                let next = self.blocks.len() as u32;
                let number = *self.index.entry(block).or_insert(next);
                if number == next {
                    self.blocks.push([0; 64]);
                }
                self.last = Some((block, number));
                number
            }
        };
        let count = &mut self.blocks[number as usize][slot];
        *count = count.saturating_add(1);
    }

    /// Judges every cube, after all points were added.
    pub(super) fn classify(&mut self) {
        self.classes = vec![[0; 2]; self.blocks.len()];
        // The block with a border of two cubes all around.
        let mut around = [[[0u8; 8]; 8]; 8];
        for (&[x, y, z], &number) in &self.index {
            let own = self.blocks[number as usize];
            let mut classes = [0; 2];
            let mut gathered = false;
            for (slot, &count) in own.iter().enumerate().filter(|(_, count)| **count > 0) {
                if count > self.enough {
                    classes[0] |= 1 << slot;
                    continue;
                }
                if !gathered {
                    self.gather([x, y, z], &mut around);
                    gathered = true;
                }
                let [i, j, k] = [slot & 3, slot >> 2 & 3, slot >> 4];
                let rows = around[k..k + 5].iter().flat_map(|plane| &plane[j..j + 5]);
                let sum: u32 = rows.flat_map(|row| &row[i..i + 5]).map(|count| u32::from(*count)).sum();
                if sum <= u32::from(self.enough) {
                    classes[1] |= 1 << slot;
                }
            }
            self.classes[number as usize] = classes;
        }
    }

    /// Copies a block and the two cubes next to it all around.
    fn gather(&self, block: [i32; 3], around: &mut [[[u8; 8]; 8]; 8]) {
        *around = [[[0; 8]; 8]; 8];
        for near in neighbourhood() {
            let at = std::array::from_fn(|axis| block[axis] + near[axis]);
            let Some(number) = self.index.get(&at) else { continue };
            let counts = &self.blocks[*number as usize];
            let [xs, ys, zs] = near.map(overlap);
            for z in zs {
                for y in ys.clone() {
                    for x in xs.clone() {
                        let [tx, ty, tz] = [x + 2 + 4 * near[0], y + 2 + 4 * near[1], z + 2 + 4 * near[2]];
                        around[tz as usize][ty as usize][tx as usize] = counts[(x + 4 * y + 16 * z) as usize];
                    }
                }
            }
        }
    }

    /// What the counts say about a point that was added.
    pub(super) fn class(&self, point: [f32; 3]) -> Class {
        let (block, slot) = split(self.cube(point));
        let Some(number) = self.index.get(&block) else { return Class::Undecided };
        let [inlier, outlier] = self.classes[*number as usize];
        match (inlier >> slot & 1, outlier >> slot & 1) {
            (1, _) => Class::Inlier,
            (_, 1) => Class::Outlier,
            _ => Class::Undecided,
        }
    }
}

/// The 27 blocks around and including one.
fn neighbourhood() -> impl Iterator<Item = [i32; 3]> {
    (-1..=1).flat_map(|z| (-1..=1).flat_map(move |y| (-1..=1).map(move |x| [x, y, z])))
}

/// Cubes of a neighbouring block that lie within reach, along an axis.
fn overlap(near: i32) -> std::ops::Range<i32> {
    match near {
        -1 => SIDE - REACH..SIDE,
        0 => 0..SIDE,
        _ => 0..REACH,
    }
}

/// The block of a cube and its place in it.
pub(super) fn split(cube: Cube) -> ([i32; 3], usize) {
    let [x, y, z] = cube.map(|axis| axis & (SIDE - 1));
    (cube.map(|axis| axis.div_euclid(SIDE)), (x + SIDE * y + SIDE * SIDE * z) as usize)
}

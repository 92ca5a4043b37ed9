//! The voxels of the map as columns over the XOY plane, three bits a voxel.

use evac_frames::{Voxel, voxel_flags};
use rustc_hash::FxHashMap;

use crate::raster::Place;

/// Columns along one side of a tile.
pub(crate) const SIDE: i32 = 8;
/// Voxels of a column in one layer.
const LAYER: i32 = 64;
/// Key of the coordinate 0 (OctoMap).
const ZERO_KEY: i32 = 32_768;

/// One bit a voxel, lowest z in bit 0.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Bits {
    occupied: u64,
    free: u64,
    ground: u64,
}

/// 8 x 8 columns of 64 voxels.
struct Layer {
    chunk: i32,
    columns: [Bits; (SIDE * SIDE) as usize],
}

/// All layers over one tile, in the order in which they were first seen, and which of its columns have changed.
#[derive(Default)]
struct Tile {
    layers: Vec<Layer>,
    changed: u64,
    ground_changed: u64,
}

/// Columns that have changed: the tile, and a bit for each column.
pub(crate) type Marks = FxHashMap<Place, u64>;

/// What is counted in a column.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Kind {
    Occupied,
    Free,
    Ground,
}

/// Why a voxel was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Refused;

/// All columns. Cells are counted from the map's origin: cell `i` spans `i * resolution` to `(i + 1) * resolution`.
pub(crate) struct Columns {
    tiles: FxHashMap<Place, Tile>,
    /// Tiles in which something has changed.
    changed: Vec<Place>,
    layers: usize,
    max_layers: usize,
    half_side: i32,
    centre: [i32; 2],
    occupied_from: f32,
}

impl Columns {
    /// `occupied_from`: log-odds from which a voxel is occupied.
    pub(crate) fn new(max_side_cells: u32, max_memory_mib: u32, occupied_from: f32) -> Self {
        Self {
            tiles: FxHashMap::default(),
            changed: Vec::new(),
            layers: 0,
            max_layers: max_memory_mib as usize * 1024 * 1024 / size_of::<Layer>(),
            half_side: (max_side_cells / 2) as i32,
            centre: [0, 0],
            occupied_from,
        }
    }

    /// Forgets all voxels and allows columns around `centre` from now on.
    pub(crate) fn restart(&mut self, centre: [i32; 2]) {
        self.tiles.clear();
        self.changed.clear();
        self.layers = 0;
        self.centre = centre;
    }

    /// Takes a voxel's state, which replaces the one before: without any flag it is unknown again.
    pub(crate) fn apply(&mut self, voxel: &Voxel) -> Result<(), Refused> {
        let [x, y, z] = voxel.key.map(|key| i32::from(key) - ZERO_KEY);
        if voxel.log_odds.is_nan() || !self.allows([x, y]) {
            return Err(Refused);
        }
        let at = tile_of([x, y]);
        if self.layers >= self.max_layers && !self.tiles.contains_key(&at) {
            return Err(Refused);
        }
        let tile = self.tiles.entry(at).or_default();
        let chunk = z.div_euclid(LAYER);
        let layer = match tile.layers.iter().position(|layer| layer.chunk == chunk) {
            Some(at) => tile.layers.get_mut(at),
            None if self.layers < self.max_layers => {
                self.layers += 1;
                tile.layers.push(Layer { chunk, columns: [Bits::default(); (SIDE * SIDE) as usize] });
                tile.layers.last_mut()
            }
            None => None,
        };
        let bits = layer.and_then(|layer| layer.columns.get_mut(index([x, y]))).ok_or(Refused)?;
        let before = *bits;
        let bit = 1u64 << z.rem_euclid(LAYER);
        let known = voxel.flags & voxel_flags::KNOWN != 0;
        let occupied = voxel.log_odds >= self.occupied_from;
        set(&mut bits.occupied, bit, known && occupied);
        set(&mut bits.free, bit, known && !occupied);
        set(&mut bits.ground, bit, voxel.flags & voxel_flags::GROUND != 0);
        if *bits != before {
            if tile.changed == 0 {
                self.changed.push(at);
            }
            tile.changed |= 1 << index([x, y]);
            tile.ground_changed |= u64::from(bits.ground != before.ground) << index([x, y]);
        }
        Ok(())
    }

    /// Whether columns may be here.
    pub(crate) fn allows(&self, [x, y]: Place) -> bool {
        let [cx, cy] = self.centre;
        let inside =
            |cell: i32, centre: i32| (-self.half_side..self.half_side).contains(&cell.saturating_sub(centre));
        inside(x, cx) && inside(y, cy)
    }

    /// Whether nothing is known at all.
    pub(crate) fn is_empty(&self) -> bool {
        self.tiles.is_empty()
    }

    /// Adds the columns that have changed since the last call to `columns`, and those whose ground has to `ground`.
    pub(crate) fn take_changes(&mut self, columns: &mut Marks, ground: &mut Marks) {
        for at in self.changed.drain(..) {
            if let Some(tile) = self.tiles.get_mut(&at) {
                *columns.entry(at).or_default() |= std::mem::take(&mut tile.changed);
                match std::mem::take(&mut tile.ground_changed) {
                    0 => {}
                    mask => *ground.entry(at).or_default() |= mask,
                }
            }
        }
    }

    /// Adds all columns to both.
    pub(crate) fn all(&self, columns: &mut Marks, ground: &mut Marks) {
        for at in self.tiles.keys() {
            columns.insert(*at, u64::MAX);
            ground.insert(*at, u64::MAX);
        }
    }

    /// The column over a cell.
    pub(crate) fn column(&self, cell: Place) -> Column<'_> {
        let tile = self.tiles.get(&tile_of(cell));
        Column { layers: tile.map_or(&[], |tile| tile.layers.as_slice()), index: index(cell) }
    }
}

/// The tile that holds a cell.
pub(crate) fn tile_of(cell: Place) -> Place {
    cell.map(|axis| axis.div_euclid(SIDE))
}

/// The place of a cell in its tile, row by row.
pub(crate) fn index([x, y]: Place) -> usize {
    (y.rem_euclid(SIDE) * SIDE + x.rem_euclid(SIDE)) as usize
}

/// Marks a cell.
pub(crate) fn mark(marks: &mut Marks, cell: Place) {
    *marks.entry(tile_of(cell)).or_default() |= 1 << index(cell);
}

/// The marked cells of a tile.
pub(crate) fn marked_cells(tile: Place, mut mask: u64) -> impl Iterator<Item = Place> {
    let [x0, y0] = tile.map(|axis| axis * SIDE);
    std::iter::from_fn(move || {
        let bit = mask.trailing_zeros() as i32;
        let cell = (mask != 0).then(|| [x0 + bit % SIDE, y0 + bit / SIDE]);
        mask &= mask.wrapping_sub(1);
        cell
    })
}

fn set(bits: &mut u64, bit: u64, value: bool) {
    *bits = if value { *bits | bit } else { *bits & !bit };
}

/// The voxels over one cell.
#[derive(Clone, Copy)]
pub(crate) struct Column<'a> {
    layers: &'a [Layer],
    index: usize,
}

impl Column<'_> {
    /// Voxels of this kind from `low` to `high`, both included.
    pub(crate) fn count(&self, kind: Kind, low: i32, high: i32) -> u32 {
        let mut count = 0;
        for (base, bits) in self.bits(kind) {
            count += (bits & mask(low.saturating_sub(base), high.saturating_sub(base))).count_ones();
        }
        count
    }

    /// The highest voxel of this kind from `low` to `high`, both included.
    pub(crate) fn highest(&self, kind: Kind, low: i32, high: i32) -> Option<i32> {
        let tops = self.bits(kind).filter_map(|(base, bits)| {
            let bits = bits & mask(low.saturating_sub(base), high.saturating_sub(base));
            (bits != 0).then(|| base + LAYER - 1 - bits.leading_zeros() as i32)
        });
        tops.max()
    }

    /// Calls `visit` with the height of each ground voxel, in no particular order.
    pub(crate) fn for_each_ground(&self, mut visit: impl FnMut(i32)) {
        for (base, mut bits) in self.bits(Kind::Ground) {
            while bits != 0 {
                visit(base + bits.trailing_zeros() as i32);
                bits &= bits - 1;
            }
        }
    }

    fn bits(&self, kind: Kind) -> impl Iterator<Item = (i32, u64)> {
        self.layers.iter().filter_map(move |layer| {
            let bits = layer.columns.get(self.index)?;
            let bits = match kind {
                Kind::Occupied => bits.occupied,
                Kind::Free => bits.free,
                Kind::Ground => bits.ground,
            };
            Some((layer.chunk * LAYER, bits))
        })
    }
}

/// Bits `low` to `high` of a layer, both included; either may lie outside.
fn mask(low: i32, high: i32) -> u64 {
    if high < 0 || low >= LAYER || low > high {
        return 0;
    }
    let from = u64::MAX << low.max(0);
    let to = u64::MAX >> (LAYER - 1 - high.min(LAYER - 1));
    from & to
}

#[cfg(test)]
mod tests;

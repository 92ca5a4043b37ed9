//! Which bricks there are: tiles of 8 x 8 x 8 bricks in a hash table, a dense array of places in each.

use rustc_hash::FxHashMap;

use crate::morton;

/// Bricks of a tile.
const TILE: usize = 512;

/// No brick.
pub(crate) const NOWHERE: u32 = u32::MAX;

/// Places of bricks by code (a voxel's Morton code without its last 9 bits).
#[derive(Clone, Debug, Default)]
pub(crate) struct Directory {
    /// Index into `tiles` by code without its last 9 bits.
    numbers: FxHashMap<u64, u32>,
    #[expect(
        clippy::vec_box,
        reason = "a longer list would copy its tiles, and hold twice their memory for a moment"
    )]
    tiles: Vec<Box<[u32; TILE]>>,
    /// Tiles without a brick, to be used again.
    empty: Vec<u32>,
    /// Bricks in each tile.
    counts: Vec<u16>,
    bricks: u32,
}

/// The tile of the last look-up: Morton order keeps to one tile for long.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Near {
    tile: u64,
    number: u32,
}

impl Default for Near {
    fn default() -> Self {
        Self { tile: u64::MAX, number: NOWHERE }
    }
}

impl Near {
    /// Whether the last look-up found a tile, if not the brick in it.
    pub(crate) fn is_tile(&self) -> bool {
        self.number != NOWHERE
    }
}

impl Directory {
    /// Number of bricks.
    pub(crate) fn len(&self) -> u32 {
        self.bricks
    }

    /// Place of a brick, or [`NOWHERE`]; faster where `near` knows the tile.
    #[inline]
    pub(crate) fn find_near(&self, code: u64, near: &mut Near) -> u32 {
        let tile = code >> 9;
        if near.tile != tile {
            *near = Near { tile, number: self.numbers.get(&tile).copied().unwrap_or(NOWHERE) };
        }
        match self.tiles.get(near.number as usize) {
            Some(places) => places[code as usize % TILE],
            None => NOWHERE,
        }
    }

    /// Notes where a brick is that was nowhere.
    pub(crate) fn insert(&mut self, code: u64, place: u32) {
        let tiles = &mut self.tiles;
        let (counts, empty) = (&mut self.counts, &mut self.empty);
        let number = *self.numbers.entry(code >> 9).or_insert_with(|| {
            empty.pop().unwrap_or_else(|| {
                tiles.push(Box::new([NOWHERE; TILE]));
                counts.push(0);
                tiles.len() as u32 - 1
            })
        });
        self.tiles[number as usize][code as usize % TILE] = place;
        self.counts[number as usize] += 1;
        self.bricks += 1;
    }

    /// Forgets a brick that is somewhere.
    pub(crate) fn remove(&mut self, code: u64) {
        let Some(&number) = self.numbers.get(&(code >> 9)) else { return };
        let place = &mut self.tiles[number as usize][code as usize % TILE];
        if std::mem::replace(place, NOWHERE) == NOWHERE {
            return;
        }
        self.bricks -= 1;
        self.counts[number as usize] -= 1;
        if self.counts[number as usize] == 0 {
            self.numbers.remove(&(code >> 9));
            self.empty.push(number);
        }
    }

    /// Codes and places of all bricks in Morton order.
    pub(crate) fn sorted(&self) -> Vec<(u64, u32)> {
        let mut tiles: Vec<_> = self.numbers.iter().map(|(&tile, &number)| (tile, number)).collect();
        tiles.sort_unstable();
        let mut all = Vec::with_capacity(self.bricks as usize);
        for (tile, number) in tiles {
            let places = self.tiles[number as usize].iter().enumerate();
            all.extend(
                places
                    .filter(|&(_, &place)| place != NOWHERE)
                    .map(|(n, &place)| (tile << 9 | n as u64, place)),
            );
        }
        all
    }

    /// Calls `visit` with code and place of every brick in a box of brick coordinates, both inclusive: by the tiles of the
    /// box where it has few, by all tiles where the map has fewer.
    #[inline]
    pub(crate) fn for_each_in(&self, low: [u16; 3], high: [u16; 3], mut visit: impl FnMut(u64, u32)) {
        let (first, last) = (low.map(|axis| axis >> 3), high.map(|axis| axis >> 3));
        let tiles = (0..3).map(|axis| u64::from(last[axis].saturating_sub(first[axis])) + 1).product::<u64>();
        if tiles > 4 * self.numbers.len() as u64 {
            for (&tile, &number) in &self.numbers {
                let at = morton::decode(tile);
                if (0..3).all(|axis| (first[axis]..=last[axis]).contains(&at[axis])) {
                    self.for_each_of_tile(tile, number, low, high, &mut visit);
                }
            }
            return;
        }
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                for x in first[0]..=last[0] {
                    let tile = morton::encode([x, y, z]);
                    if let Some(&number) = self.numbers.get(&tile) {
                        self.for_each_of_tile(tile, number, low, high, &mut visit);
                    }
                }
            }
        }
    }

    /// The same within one tile.
    #[inline]
    fn for_each_of_tile(
        &self,
        tile: u64,
        number: u32,
        low: [u16; 3],
        high: [u16; 3],
        visit: &mut impl FnMut(u64, u32),
    ) {
        let corner = morton::decode(tile << 9);
        let span = |axis: usize| {
            let from = low[axis].saturating_sub(corner[axis]).min(8);
            from..=(high[axis] - corner[axis]).min(7)
        };
        let places = &self.tiles[number as usize];
        for z in span(2) {
            let z = morton::within([0, 0, z]);
            for y in span(1) {
                let yz = morton::within([0, y, 0]) | z;
                for x in span(0) {
                    let brick = morton::within([x, 0, 0]) | yz;
                    let place = places[brick];
                    if place != NOWHERE {
                        visit(tile << 9 | brick as u64, place);
                    }
                }
            }
        }
    }

    /// Bytes held.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.tiles.len() * size_of::<[u32; TILE]>()
            + self.tiles.capacity() * size_of::<Box<[u32; TILE]>>()
            + self.counts.capacity() * 2
            + table_bytes(self.numbers.capacity(), size_of::<(u64, u32)>())
    }
}

/// Bytes of a hash table with room for `capacity` entries: it keeps a control byte beside each entry and an eighth free.
pub(crate) fn table_bytes(capacity: usize, entry: usize) -> usize {
    capacity * 8 / 7 * (entry + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(directory: &Directory, code: u64) -> u32 {
        directory.find_near(code, &mut Near::default())
    }

    #[test]
    fn bricks_are_found_in_morton_order_and_forgotten_with_their_tile() {
        let mut directory = Directory::default();
        let codes = [5_u64, 3, 513, 1 << 38, 4];
        for (place, &code) in codes.iter().enumerate() {
            directory.insert(code, place as u32);
        }
        assert_eq!(directory.sorted(), [(3, 1), (4, 4), (5, 0), (513, 2), (1 << 38, 3)]);
        directory.remove(513);
        directory.remove(513);
        directory.remove(77);
        assert_eq!((find(&directory, 513), find(&directory, 5), directory.len()), (NOWHERE, 0, 4));
        let tiles = directory.tiles.len();
        directory.insert(1024, 9);
        assert_eq!(
            (find(&directory, 1024), find(&directory, 1025), directory.tiles.len()),
            (9, NOWHERE, tiles)
        );
    }
}

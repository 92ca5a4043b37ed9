//! The map: four levels of voxels with planes, in one arena of fixed capacity (design section 5.4).

use evac_geometry::nalgebra::Vector3;

use super::cell::{Cell, Plane};
use super::drift::Piece;
use super::sections::SectionId;
use super::voxel::{EDGES, Voxel};

/// Candidates looked at for one eviction.
const EVICTION_SAMPLE: usize = 16;
const EMPTY: u64 = 0;

/// Voxels of all levels behind one open-addressing table; both are allocated once.
#[derive(Debug, Clone)]
pub(crate) struct PlaneMap {
    cells: Vec<Cell>,
    max_cells: usize,
    /// Variance of a range, m^2.
    range_variance: f64,
    /// Key and cell index; key [`EMPTY`] is a free slot. Linear probing.
    slots: Vec<[u64; 2]>,
    mask: usize,
    hand: usize,
    frame: u32,
    section: SectionId,
    piece: Piece,
    /// Key and index that each level used last: neighbouring points mostly share a coarse voxel.
    recent: [(u64, usize); EDGES.len()],
    /// Cells given up to stay below the ceiling.
    pub(crate) evicted: u64,
}

impl PlaneMap {
    /// Allocates room for `max_cells` and a table at most half full; `range_noise` in metres.
    pub(crate) fn new(max_cells: usize, range_noise: f64) -> Self {
        let slots = (2 * max_cells).next_power_of_two();
        Self {
            cells: Vec::with_capacity(max_cells),
            max_cells,
            range_variance: range_noise * range_noise,
            slots: vec![[EMPTY; 2]; slots],
            mask: slots - 1,
            hand: 0,
            frame: 0,
            section: 0,
            piece: 0,
            recent: [(EMPTY, 0); EDGES.len()],
            evicted: 0,
        }
    }

    /// Forgets everything, keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.cells.clear();
        self.slots.fill([EMPTY; 2]);
        self.recent = [(EMPTY, 0); EDGES.len()];
        self.hand = 0;
    }

    /// Counts a frame, for the age of cells; cells that it creates belong to `section` and `piece`.
    pub(crate) fn next_frame(&mut self, section: SectionId, piece: Piece) {
        (self.section, self.piece) = (section, piece);
        self.frame = self.frame.saturating_add(1);
    }

    /// Cells in use.
    pub(crate) fn len(&self) -> usize {
        self.cells.len()
    }

    /// Adds a point seen along the unit vector `beam` at every level; both are the current section's.
    #[cfg(test)]
    pub(crate) fn insert(&mut self, point: &Vector3<f64>, beam: &Vector3<f64>) {
        self.insert_in(point, beam, &mut |_, point| *point);
    }

    /// The same where cells of other sections than the current one may be hit: `in_section` brings the point into a section's
    /// frame. The beam may stay as it is, since sections lie to each other as they seem to but for fractions of a degree.
    pub(crate) fn insert_in(
        &mut self,
        point: &Vector3<f64>,
        beam: &Vector3<f64>,
        in_section: &mut impl FnMut(SectionId, &Vector3<f64>) -> Vector3<f64>,
    ) {
        let Some(voxel) = Voxel::of(point) else { return };
        for (level, edge) in EDGES.iter().enumerate() {
            let key = voxel.key(level);
            let index = match self.recent[level] {
                (recent, index) if recent == key => index,
                _ => self.find_or_create(key),
            };
            self.recent[level] = (key, index);
            let (frame, section, range_variance) = (self.frame, self.section, self.range_variance);
            if let Some(cell) = self.cells.get_mut(index) {
                cell.last_used = frame;
                if cell.section == section {
                    cell.add(point, beam, *edge, range_variance);
                } else {
                    cell.add(&in_section(cell.section, point), beam, *edge, range_variance);
                }
            }
        }
    }

    /// The cell of `level` that `voxel` lies in, with its index.
    pub(crate) fn find(&self, level: usize, voxel: &Voxel) -> Option<(usize, &Cell)> {
        let slot = self.slots[self.slot_of(voxel.key(level))];
        if slot[0] == EMPTY {
            return None;
        }
        let index = slot[1] as usize;
        Some((index, self.cells.get(index)?))
    }

    /// The plane of the cell with this index.
    pub(crate) fn plane(&self, index: usize) -> Option<&Plane> {
        self.cells.get(index)?.plane()
    }

    /// The slot that holds `key`, or the free slot where it belongs.
    fn slot_of(&self, key: u64) -> usize {
        let mut slot = hash(key) & self.mask;
        while self.slots[slot][0] != EMPTY && self.slots[slot][0] != key {
            slot = (slot + 1) & self.mask;
        }
        slot
    }

    fn find_or_create(&mut self, key: u64) -> usize {
        let slot = self.slot_of(key);
        if self.slots[slot][0] == key {
            return self.slots[slot][1] as usize;
        }
        if self.cells.len() < self.max_cells {
            self.cells.push(Cell::new(key, self.frame, self.section, self.piece));
            self.slots[slot] = [key, self.cells.len() as u64 - 1];
            return self.cells.len() - 1;
        }
        let index = self.evict();
        self.cells[index] = Cell::new(key, self.frame, self.section, self.piece);
        let slot = self.slot_of(key);
        self.slots[slot] = [key, index as u64];
        index
    }

    /// Frees the longest unused of the next few cells under a hand that goes round, sparing the start.
    fn evict(&mut self) -> usize {
        // The first cells in the arena are the oldest; an eighth of it is the most that the start may keep.
        let kept = self.max_cells / 8;
        let mut victim = self.hand.max(kept);
        for _ in 0..EVICTION_SAMPLE {
            self.hand = if self.hand + 1 < self.max_cells { self.hand.max(kept) + 1 } else { kept };
            let age = |index: usize| self.cells.get(index).map_or(u32::MAX, |cell| cell.last_used);
            if age(self.hand) < age(victim) {
                victim = self.hand;
            }
        }
        self.remove_slot(self.cells[victim].key);
        self.recent = self.recent.map(|(key, index)| if index == victim { (EMPTY, 0) } else { (key, index) });
        self.evicted += 1;
        victim
    }

    /// Deletes a key by moving back what follows it in the probe sequence (no tombstones).
    fn remove_slot(&mut self, key: u64) {
        let mut hole = self.slot_of(key);
        let mut next = hole;
        loop {
            next = (next + 1) & self.mask;
            let [key, _] = self.slots[next];
            if key == EMPTY {
                break;
            }
            let home = hash(key) & self.mask;
            // Distance from home, cyclic: movable if the hole is not before its home.
            if (next.wrapping_sub(home) & self.mask) >= (next.wrapping_sub(hole) & self.mask) {
                self.slots[hole] = self.slots[next];
                hole = next;
            }
        }
        self.slots[hole] = [EMPTY; 2];
    }
}

/// Fibonacci hashing with the high bits folded down.
fn hash(key: u64) -> usize {
    let mixed = (key ^ (key >> 32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed ^ (mixed >> 29)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find<'a>(map: &'a PlaneMap, level: usize, point: &Vector3<f64>) -> Option<(usize, &'a Cell)> {
        map.find(level, &Voxel::of(point)?)
    }

    #[test]
    fn a_full_map_stays_within_its_ceiling_and_finds_all_that_it_holds() {
        let mut map = PlaneMap::new(4096, 0.02);
        for frame in 0..60 {
            map.next_frame(0, 0);
            for i in 0..200 {
                map.insert(
                    &Vector3::new(f64::from(frame) * 0.9, f64::from(i) * 0.31 - 30.0, 0.05),
                    &Vector3::x(),
                );
            }
        }
        assert!(map.len() == 4096 && map.evicted > 1000);
        let mut indices: Vec<usize> =
            map.slots.iter().filter(|slot| slot[0] != EMPTY).map(|s| s[1] as usize).collect();
        for [key, index] in map.slots.iter().filter(|slot| slot[0] != EMPTY) {
            assert_eq!(map.cells[*index as usize].key, *key);
            assert_eq!(map.slots[map.slot_of(*key)][1], *index);
        }
        indices.sort_unstable();
        assert_eq!(indices, (0..4096).collect::<Vec<_>>());
        let here = Vector3::new(59.0 * 0.9, 0.0, 0.05);
        assert!((0..EDGES.len()).all(|level| find(&map, level, &here).is_some()));
    }

    #[test]
    fn the_start_outlives_what_came_between() {
        let mut map = PlaneMap::new(4096, 0.02);
        let start = Vector3::new(0.1, 0.1, 0.1);
        map.insert(&start, &Vector3::x());
        for i in 0..20_000 {
            map.next_frame(0, 0);
            map.insert(&Vector3::new(10.0 + f64::from(i), 0.0, 0.0), &Vector3::x());
        }
        assert!(find(&map, 0, &start).is_some());
        assert!(find(&map, 0, &Vector3::new(1000.0, 0.0, 0.0)).is_none());
    }

    #[test]
    fn a_wall_stays_in_its_section_where_one_sees_it_whose_own_section_lies_three_centimetres_beside() {
        let mut map = PlaneMap::new(4096, 0.02);
        let wall = |map: &mut PlaneMap, x: f64, shift: f64| {
            for i in 0..1000 {
                let noise = if (i / 40 + i) % 2 == 0 { 0.01 } else { -0.01 };
                let point = Vector3::new(x + noise, f64::from(i % 40) * 0.02, f64::from(i / 40) * 0.03);
                map.insert_in(&point, &Vector3::x(), &mut |section, point| {
                    assert_eq!(section, 0);
                    point - Vector3::new(shift, 0.0, 0.0)
                });
            }
        };
        let centroid = |map: &PlaneMap| {
            let (_, cell) = find(map, 0, &Vector3::new(2.0, 0.4, 0.4)).unwrap();
            (cell.section, cell.plane().unwrap().points, cell.plane().unwrap().centroid.x)
        };
        wall(&mut map, 2.0, f64::NAN);
        let before = centroid(&map);
        map.next_frame(1, 0);
        wall(&mut map, 2.03, 0.03);
        let (section, points, x) = centroid(&map);
        assert!(section == 0 && points > 1.5 * before.1);
        assert!((x - 2.0).abs() < 1e-3 && (before.2 - 2.0).abs() < 1e-3, "{x} {}", before.2);
    }

    #[test]
    fn places_that_no_key_can_name_are_refused() {
        let mut map = PlaneMap::new(4096, 0.02);
        for x in [f64::NAN, f64::INFINITY, 1e9, -1e9] {
            map.insert(&Vector3::new(x, 0.0, 0.0), &Vector3::x());
        }
        assert_eq!(map.len(), 0);
    }
}

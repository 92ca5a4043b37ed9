//! The local map: a hash grid of voxels, each with the mean of its points, kept by distance: from the LiDAR, and along the way
//! since they were seen.

use evac_geometry::nalgebra::Vector3;

use super::nearest::{NEIGHBOURS, insert_sorted};

const COORDINATE_BITS: u32 = 20;
const EMPTY: u64 = 0;
/// Points after which a voxel's mean is not changed any more: it is exact to a millimetre, and a map that followed every
/// new pose would creep.
const FULL: u32 = 200;
/// Voxels with fewer points are not matched: their mean is as noisy as the points.
const RIPE: u32 = 3;
/// Share of the table that is looked through for far voxels each frame.
const SWEEP: usize = 32;
/// The radius shrinks by this factor per frame while the map is nearly full, down to [`LEAST_RADIUS`], and recovers.
const SHRINK: f64 = 0.9;
const LEAST_RADIUS: f64 = 5.0;

/// Voxels behind one open-addressing table that is allocated once.
#[derive(Debug)]
pub(crate) struct CentroidMap {
    slots: Vec<Voxel>,
    mask: usize,
    edge: f64,
    len: usize,
    max_len: usize,
    hand: usize,
    radius: f64,
    max_radius: f64,
    /// Way gone so far, and that after which an unseen voxel is stale, metres.
    way: f32,
    max_way: f32,
    /// Voxels given up because they were too far or stale, and new ones refused because the map was full.
    pub(crate) evicted: u64,
    pub(crate) refused: u64,
}

#[derive(Debug, Clone, Copy)]
struct Voxel {
    key: u64,
    count: u32,
    /// Way gone when it was last seen, metres.
    seen: f32,
    mean: Vector3<f64>,
}

impl Voxel {
    const FREE: Self = Self { key: EMPTY, count: 0, seen: 0.0, mean: Vector3::new(0.0, 0.0, 0.0) };
}

impl CentroidMap {
    /// Allocates room for `max_voxels` of `edge` metres in a table at most half full.
    pub(crate) fn new(edge: f64, max_voxels: usize, max_radius: f64, max_way: f64) -> Self {
        let slots = (2 * max_voxels).next_power_of_two();
        Self {
            slots: vec![Voxel::FREE; slots],
            mask: slots - 1,
            edge,
            len: 0,
            max_len: max_voxels,
            hand: 0,
            radius: max_radius,
            max_radius,
            way: 0.0,
            max_way: max_way as f32,
            evicted: 0,
            refused: 0,
        }
    }

    /// Voxels in use.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Forgets everything, keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.slots.fill(Voxel::FREE);
        self.len = 0;
    }

    /// Adds a point to the mean of its voxel.
    pub(crate) fn insert(&mut self, point: &Vector3<f64>) {
        let Some(key) = self.cell(point).and_then(key) else { return };
        let slot = self.slot_of(key);
        let Some(voxel) = self.slots.get_mut(slot) else { return };
        if voxel.key == EMPTY {
            if self.len >= self.max_len {
                self.refused += 1;
                return;
            }
            *voxel = Voxel { key, ..Voxel::FREE };
            self.len += 1;
        }
        if voxel.seen < self.way - self.max_way {
            *voxel = Voxel { key, ..Voxel::FREE };
        }
        voxel.seen = self.way;
        if voxel.count < FULL {
            voxel.count += 1;
            voxel.mean += (point - voxel.mean) / f64::from(voxel.count);
        }
    }

    /// The nearest voxel means around `point` within `reach` voxels to every side; `None` if there are not enough.
    pub(crate) fn nearest(&self, point: &Vector3<f64>, reach: i64) -> Option<[Vector3<f64>; NEIGHBOURS]> {
        let [x, y, z] = self.cell(point)?;
        let mut nearest = [(f64::INFINITY, Vector3::zeros()); NEIGHBOURS];
        for i in -reach..=reach {
            for j in -reach..=reach {
                for k in -reach..=reach {
                    let Some(key) = key([x + i, y + j, z + k]) else { continue };
                    let Some(voxel) = self.slots.get(self.slot_of(key)) else { continue };
                    if voxel.key == key && voxel.count >= RIPE && voxel.seen >= self.way - self.max_way {
                        insert_sorted(
                            &mut nearest,
                            ((voxel.mean - point).norm_squared(), voxel.mean),
                            self.edge * self.edge / 4.0,
                        );
                    }
                }
            }
        }
        nearest[NEIGHBOURS - 1].0.is_finite().then(|| nearest.map(|(_, mean)| mean))
    }

    /// Gives up voxels that are far from the LiDAR or stale: a part of the table each frame. `way` is that gone so far, metres.
    pub(crate) fn forget_far(&mut self, lidar: &Vector3<f64>, way: f64) {
        self.way = way as f32;
        let nearly_full = self.len > self.max_len / 4 * 3;
        let factor = if nearly_full { SHRINK } else { 1.0 / SHRINK };
        self.radius = (self.radius * factor).clamp(LEAST_RADIUS.min(self.max_radius), self.max_radius);
        for _ in 0..self.slots.len() / SWEEP {
            let slot = self.hand;
            let far = self.slots.get(slot).is_some_and(|voxel| {
                let is_far = (voxel.mean - lidar).norm_squared() > self.radius * self.radius;
                voxel.key != EMPTY && (is_far || voxel.seen < self.way - self.max_way)
            });
            if far {
                // What moves into the freed slot is looked at next.
                self.remove(slot);
                self.evicted += 1;
            } else {
                self.hand = (self.hand + 1) & self.mask;
            }
        }
    }

    fn cell(&self, point: &Vector3<f64>) -> Option<[i64; 3]> {
        let cell = point / self.edge;
        // NaN and infinity are in no cell.
        cell.iter().all(|c| c.abs() < 1e9).then(|| [cell.x, cell.y, cell.z].map(|c| c.floor() as i64))
    }

    /// The slot that holds `key`, or the free slot where it belongs.
    fn slot_of(&self, key: u64) -> usize {
        let mut slot = hash(key) & self.mask;
        while self.slots[slot].key != EMPTY && self.slots[slot].key != key {
            slot = (slot + 1) & self.mask;
        }
        slot
    }

    /// Frees a slot by moving back what follows it in the probe sequence (no tombstones).
    fn remove(&mut self, slot: usize) {
        let (mut hole, mut next) = (slot, slot);
        loop {
            next = (next + 1) & self.mask;
            let voxel = self.slots[next];
            if voxel.key == EMPTY {
                break;
            }
            let home = hash(voxel.key) & self.mask;
            // Distance from home, cyclic: movable if the hole is not before its home.
            if (next.wrapping_sub(home) & self.mask) >= (next.wrapping_sub(hole) & self.mask) {
                self.slots[hole] = voxel;
                hole = next;
            }
        }
        self.slots[hole] = Voxel::FREE;
        self.len -= 1;
    }
}

/// Three signed coordinates of 20 bits behind a leading one; never [`EMPTY`]. `None` beyond them.
fn key(cell: [i64; 3]) -> Option<u64> {
    let limit = 1i64 << (COORDINATE_BITS - 1);
    cell.iter().try_fold(1, |key, coordinate| {
        (-limit..limit).contains(coordinate).then(|| (key << COORDINATE_BITS) | (coordinate + limit) as u64)
    })
}

/// Fibonacci hashing with the high bits folded down.
fn hash(key: u64) -> usize {
    let mixed = (key ^ (key >> 32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed ^ (mixed >> 29)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ripe(map: &mut CentroidMap, point: Vector3<f64>) {
        (0..RIPE).for_each(|_| map.insert(&point));
    }

    #[test]
    fn a_voxel_holds_the_mean_of_its_points_until_it_is_full() {
        let mut map = CentroidMap::new(0.5, 1024, 50.0, 30.0);
        for i in 0..FULL {
            let off = if i % 2 == 0 { 0.1 } else { -0.1 };
            for x in 0..5 {
                map.insert(&Vector3::new(f64::from(x) * 0.5 + 0.25 + off, 0.25, 0.25));
            }
        }
        map.insert(&Vector3::new(0.45, 0.25, 0.25));
        let near = map.nearest(&Vector3::new(1.2, 0.25, 0.25), 2).unwrap();
        assert!((near[0] - Vector3::new(1.25, 0.25, 0.25)).norm() < 1e-9);
        assert!(near.iter().any(|mean| (mean.x - 0.25).abs() < 1e-9));
        assert!(map.nearest(&Vector3::new(1.2, 0.25, 0.25), 1).is_none());
    }

    #[test]
    fn a_wall_on_the_border_of_two_layers_of_voxels_gives_five_places_on_it() {
        let mut map = CentroidMap::new(0.3, 1024, 50.0, 30.0);
        for i in 0..2000 {
            let side = if i % 2 == 0 { 0.01 } else { -0.01 };
            map.insert(&Vector3::new(1.2 + side, f64::from(i % 40) * 0.03, f64::from(i / 40) * 0.03));
        }
        let near = map.nearest(&Vector3::new(1.2, 0.6, 0.6), 1).unwrap();
        for (i, a) in near.iter().enumerate() {
            assert!(near.iter().skip(i + 1).all(|b| (a - b).yz().norm() > 0.1), "{near:?}");
        }
        assert!(
            near.windows(2).all(|w| (w[0] - Vector3::new(1.2, 0.6, 0.6)).norm()
                <= (w[1] - Vector3::new(1.2, 0.6, 0.6)).norm())
        );
    }

    #[test]
    fn far_voxels_are_given_up_and_near_ones_are_found_afterwards() {
        let mut map = CentroidMap::new(0.3, 4096, 20.0, 30.0);
        for i in 0..3000 {
            ripe(&mut map, Vector3::new(f64::from(i % 300) * 0.31, f64::from(i / 300) * 0.31, 0.1));
        }
        let before = map.len();
        for _ in 0..2 * SWEEP {
            map.forget_far(&Vector3::zeros(), 0.0);
        }
        assert!(map.len() < before / 4 && map.evicted as usize == before - map.len());
        assert!(map.slots.iter().filter(|v| v.key != EMPTY).all(|v| v.mean.norm() <= 20.0));
        for i in 0..60 {
            assert!(map.nearest(&Vector3::new(f64::from(i) * 0.31, 1.0, 0.1), 1).is_some());
        }
        assert_eq!(map.slots.iter().filter(|voxel| voxel.key != EMPTY).count(), map.len());
    }

    #[test]
    fn what_was_seen_too_long_a_way_ago_is_not_matched_and_begins_anew() {
        let mut map = CentroidMap::new(0.3, 4096, 100.0, 30.0);
        let points: Vec<_> = (0..9).map(|i| Vector3::new(0.1, f64::from(i) * 0.3 + 0.1, 0.1)).collect();
        points.iter().for_each(|point| ripe(&mut map, *point));
        map.forget_far(&Vector3::zeros(), 29.0);
        assert!(map.nearest(&points[4], 2).is_some());
        map.way = 31.0;
        assert!(map.nearest(&points[4], 2).is_none());
        let moved = Vector3::new(0.1, 0.0, 0.0);
        points.iter().for_each(|point| ripe(&mut map, point + moved));
        assert!((map.nearest(&points[4], 2).unwrap()[0] - points[4] - moved).norm() < 1e-9);
    }

    #[test]
    fn a_full_map_refuses_and_draws_in_its_radius() {
        let mut map = CentroidMap::new(0.3, 1024, 100.0, 1e3);
        for step in 0..400 {
            let lidar = Vector3::new(f64::from(step) * 0.5, 0.0, 0.0);
            for i in -20..20 {
                ripe(&mut map, lidar + Vector3::new(0.0, f64::from(i) * 0.31, 0.0));
            }
            map.forget_far(&lidar, lidar.x);
            assert!(map.len() <= 1024);
        }
        assert!(map.evicted > 1000 && map.radius < 100.0);
        assert!(map.nearest(&Vector3::new(199.0, 0.0, 0.0), 2).is_some());
    }

    #[test]
    fn places_that_no_key_can_name_are_refused() {
        let mut map = CentroidMap::new(0.3, 1024, 100.0, 1e3);
        for x in [f64::NAN, f64::INFINITY, 1e12, -1e6] {
            map.insert(&Vector3::new(x, 0.0, 0.0));
            assert!(map.nearest(&Vector3::new(x, 0.0, 0.0), 1).is_none());
        }
        assert_eq!(map.len(), 0);
    }
}

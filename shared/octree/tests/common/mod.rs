//! Maps to ask about.

#![allow(dead_code, reason = "each test program uses a part")]

use evac_octree::{Key, MapConfig, OctreeMap, Scan, ScanOptions};

/// Random numbers of which tests draw their scenes.
pub(crate) struct Lcg(pub(crate) u64);

impl Lcg {
    pub(crate) fn uniform(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }

    pub(crate) fn point(&mut self, half: [f32; 3]) -> [f32; 3] {
        half.map(|half| (2.0 * self.uniform() - 1.0) * half)
    }
}

/// A room of about 8 x 6 x 3 m from a walk through it: some space is free for sure and pruned, some seen once, some
/// never, and a few ground flags.
pub(crate) fn room(seed: u64, scans: usize) -> OctreeMap {
    let mut map = OctreeMap::new(MapConfig::new(0.1)).unwrap();
    insert(&mut map, seed, scans, &ScanOptions::default());
    map
}

pub(crate) fn insert(map: &mut OctreeMap, seed: u64, scans: usize, options: &ScanOptions) {
    let mut random = Lcg(seed);
    for step in 0..scans {
        let origin = [0.05 * step as f32 - 0.5, 0.3 * random.uniform(), 0.2];
        let hits: Vec<_> = (0..1500)
            .map(|_| {
                let mut wall = random.point([4.0, 3.0, 1.5]);
                let axis = (random.uniform() * 2.99) as usize;
                wall[axis] = [4.0_f32, 3.0, 1.5][axis].copysign(wall[axis]) + 0.02 * random.uniform();
                wall
            })
            .collect();
        let ground: Vec<_> =
            (0..50).map(|_| random.point([2.0, 2.0, 0.0])).map(|[x, y, _]| [x, y, -1.3]).collect();
        map.insert_scan(&Scan { origin, hits: &hits, ground: &ground, misses: &[] }, options);
    }
}

/// A box of keys somewhere in the room.
pub(crate) fn some_box(random: &mut Lcg, edge: f32) -> (Key, Key) {
    let low = random.point([4.5, 3.5, 1.8]);
    let min = low.map(|axis| (32_768.0 + axis * 10.0) as u16);
    let size = [0, 1, 2].map(|_| (random.uniform() * edge) as u16);
    (min, std::array::from_fn(|axis| min[axis] + size[axis]))
}

pub(crate) fn inside(key: Key, (min, max): (Key, Key)) -> bool {
    (0..3).all(|axis| (min[axis]..=max[axis]).contains(&key[axis]))
}

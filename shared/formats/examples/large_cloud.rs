//! Writes a cloud of any size as binary PCD: a station of two levels, 150 x 60 m, with pillars, walls, 2 cm of noise and strays, in
//! the order of a walk along it.
//!
//! `cargo run --release -p evac-formats --example large_cloud -- CLOUD.pcd 100000000`

use std::path::Path;

use evac_formats::FormatError;
use evac_formats::cloud::{CloudPoint, Intensity};
use evac_formats::pcd::{self, WriteAs};

const LENGTH_M: f32 = 150.0;
const WIDTH_M: f32 = 60.0;
/// How far the walker sees along the building.
const VIEW_M: f32 = 15.0;

fn main() -> Result<(), FormatError> {
    let mut words = std::env::args().skip(1);
    let path = words.next().unwrap_or_else(|| "cloud.pcd".to_owned());
    let points: u32 = words.next().and_then(|word| word.parse().ok()).unwrap_or(1_000_000);
    let mut random = Random(1);
    let cloud = (0..points).map(|i| point(i as f32 / points as f32, &mut random));
    pcd::write(Path::new(&path), cloud, Intensity::Dropped, WriteAs::Binary)
}

/// A point seen when `share` of the walk is done.
fn point(share: f32, random: &mut Random) -> CloudPoint {
    let x = (share * LENGTH_M + VIEW_M * (2.0 * random.uniform() - 1.0)).clamp(0.0, LENGTH_M);
    let y = WIDTH_M * random.uniform();
    let up = random.uniform();
    let [x, y, z] = match random.below(1000) {
        // Strays.
        0..3 => [x, y, 8.0 * up],
        // Floors of both levels, the slab's underside and the ceiling.
        3..350 => [x, y, 0.0],
        350..550 => [x, y, 4.5],
        550..600 => [x, y, 4.2],
        600..700 => [x, y, 8.0],
        // Long walls.
        700..850 => [x, WIDTH_M * random.below(2) as f32, 8.0 * up],
        // Pillars every 7.5 m, four rows.
        _ => {
            let side = random.uniform() - 0.5;
            let (along, across) = ((x / 7.5).round() * 7.5, 12.0 + 12.0 * random.below(4) as f32);
            match random.below(4) {
                0 => [along + side, across - 0.5, 8.0 * up],
                1 => [along + side, across + 0.5, 8.0 * up],
                2 => [along - 0.5, across + side, 8.0 * up],
                _ => [along + 0.5, across + side, 8.0 * up],
            }
        }
    };
    let [x, y, z] = [x, y, z].map(|axis| axis + 0.02 * random.gauss());
    CloudPoint { x, y, z, intensity: 0.0 }
}

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn uniform(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 24) as f32
    }

    fn below(&mut self, end: u64) -> u64 {
        self.next() % end
    }

    /// Mean 0, deviation 1: four uniforms, which is near enough.
    fn gauss(&mut self) -> f32 {
        ((0..4).map(|_| self.uniform()).sum::<f32>() - 2.0) * 3f32.sqrt()
    }
}

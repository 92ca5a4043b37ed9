//! The same questions to our map as `octomap.cpp` asks, in the same order.

use std::fs;
use std::path::Path;

use anyhow::Context as _;
use evac_octree::{Key, Leaf, MapConfig, OctreeMap, Pruning};

use crate::clock::{median, thread_ms};
use crate::octomap::Figures;

const CASTS: usize = 2000;
const BOXES: usize = 2000;
const ROUNDS: usize = 5;

/// Rounds of questions that take less than [`SHORT_MS`]: one interruption must not be the answer.
const MANY_ROUNDS: usize = 25;
const SHORT_MS: f64 = 5.0;

/// Random numbers as the C++ side draws them.
struct Lcg(u64);

impl Lcg {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 * 2.0_f64.powi(-53)
    }
}

/// One line: what, our milliseconds, the name of OctoMap's figure, and whether the answers are the same (`None` where they
/// cannot be compared).
struct Row {
    what: &'static str,
    ours: f64,
    theirs: &'static str,
    same: Option<bool>,
}

/// Asks, prints times and ratios, and says whether all answers agree.
pub(crate) fn compare(
    map: &OctreeMap,
    at: [f32; 3],
    max_range: f64,
    scans: usize,
    theirs: Option<&Figures>,
    folder: &Path,
) -> anyhow::Result<bool> {
    let figure = |key: &str| theirs.and_then(|figures| figures.last(key));
    let is = |key: &str, value: f64| figure(key).map(|theirs| (theirs - value).abs() <= 1e-6 * value.abs());
    let file = |name: &str, bytes: &[u8]| -> anyhow::Result<Option<bool>> {
        Ok(if theirs.is_some() { Some(fs::read(folder.join(name))? == bytes) } else { None })
    };
    let mut rows = Vec::new();

    let (mut leaves, mut sum) = (0_u64, 0.0);
    let ours = timed(|| {
        (leaves, sum) = (0, 0.0);
        map.for_each_leaf(16, |leaf| {
            leaves += 1;
            sum += f64::from(leaf.log_odds);
        });
    });
    let same = is("leaves", leaves as f64).zip(is("leaves_sum", sum)).map(|(a, b)| a && b);
    rows.push(Row { what: "all leaves", ours, theirs: "leaves_ms", same });

    let mut sum = 0.0;
    let ours = timed(|| {
        sum = 0.0;
        for_each_in_boxes(map, at, |leaf, _| sum += f64::from(leaf.log_odds) + f64::from(leaf.depth));
    });
    std::hint::black_box(sum);
    // The voxels that leaves and boxes share: OctoMap tells a large leaf whole, our map brick by brick.
    let (mut voxels, mut weighed) = (0_u64, 0.0);
    for_each_in_boxes(map, at, |leaf, [min, max]| {
        let shared = (0..3).map(|axis| {
            let (low, high) = (leaf.key[axis], u32::from(leaf.key[axis]) + leaf.edge() - 1);
            (u32::from(max[axis]).min(high) + 1).saturating_sub(min[axis].max(low).into())
        });
        let shared = shared.map(u64::from).product::<u64>();
        voxels += shared;
        weighed += shared as f64 * f64::from(leaf.log_odds);
    });
    let same = is("boxes", voxels as f64).zip(is("boxes_sum", weighed)).map(|(a, b)| a && b);
    rows.push(Row { what: "2000 boxes of 1 m", ours, theirs: "boxes_ms", same });

    let (mut hits, mut sum) = (0_u64, 0.0);
    let ours = timed(|| {
        let mut random = Lcg(2);
        (hits, sum) = (0, 0.0);
        for _ in 0..CASTS {
            let mut direction: [f32; 3] = std::array::from_fn(|_| (random.uniform() * 2.0 - 1.0) as f32);
            direction[2] *= 0.25;
            if let Some(cast) = map.cast_ray(at, direction, true, Some(max_range)) {
                hits += u64::from(cast.hit);
                sum += f64::from(cast.end[0] + cast.end[1] + cast.end[2]);
            }
        }
    });
    let same = is("casts", hits as f64).zip(is("casts_sum", sum)).map(|(a, b)| a && b);
    rows.push(Row { what: "2000 rays", ours, theirs: "casts_ms", same });

    let mut nodes = 0;
    let ours = timed(|| nodes = map.node_count());
    rows.push(Row { what: "prune", ours, theirs: "prune_ms", same: is("pruned_nodes", nodes as f64) });

    let mut bytes = Vec::new();
    let ours = timed(|| bytes = map.ot_bytes());
    let newest = folder.join(format!("{scans}.ot"));
    let same = if theirs.is_some() { Some(fs::read(newest)? == bytes) } else { None };
    rows.push(Row { what: "write .ot", ours, theirs: "write_ot_ms", same });
    let config = MapConfig { sensor: *map.sensor(), max_bytes: 4 << 30, ..MapConfig::new(1.0) };
    let (read, ours) = timed_reading(&bytes, config)?;
    let same = read.ot_bytes() == bytes;
    rows.push(Row { what: "read .ot", ours, theirs: "read_ot_ms", same: Some(same) });

    let ours = timed(|| bytes = map.bt_bytes());
    rows.push(Row { what: "write .bt", ours, theirs: "write_bt_ms", same: file("map.bt", &bytes)? });
    let (read, ours) = timed_reading(&bytes, config)?;
    let same = file("read_bt.ot", &read.ot_bytes())?;
    rows.push(Row { what: "read .bt", ours, theirs: "read_bt_ms", same });

    let copy = || OctreeMap::from_tree(&map.to_tree(Pruning::Full), *map.sensor(), 4 << 30);
    let (mut merged, mut times) = (copy()?, Vec::new());
    for _ in 0..ROUNDS {
        merged = copy()?;
        let start = thread_ms();
        merged.merge(map)?;
        times.push(thread_ms() - start);
    }
    let same = file("merged.ot", &merged.ot_bytes())?;
    rows.push(Row { what: "merge with itself", ours: median(&times), theirs: "merge_ms", same });

    let all_same = rows.iter().all(|row| row.same != Some(false));
    for Row { what, ours, theirs, same } in rows {
        print!("    {what:<36} {ours:9.3} ms");
        if let Some(theirs) = figure(theirs) {
            print!("   OctoMap {theirs:9.3} ms   ratio {:6.1}", theirs / ours);
        }
        println!("   {}", same.map_or("", |same| if same { "same" } else { "DIFFERENT" }));
    }
    Ok(all_same)
}

/// Calls `visit` with each leaf of the boxes and the box.
fn for_each_in_boxes(map: &OctreeMap, at: [f32; 3], mut visit: impl FnMut(Leaf, [Key; 2])) {
    let mut random = Lcg(1);
    for _ in 0..BOXES {
        let low: [f32; 3] = std::array::from_fn(|axis| {
            let reach = if axis == 2 { 2.0 } else { 10.0 };
            (f64::from(at[axis]) + (random.uniform() * 2.0 - 1.0) * reach) as f32
        });
        let space = map.space();
        if let (Some(min), Some(max)) = (space.key(low), space.key(low.map(|axis| axis + 1.0))) {
            map.for_each_leaf_in(min, max, |leaf| visit(leaf, [min, max]));
        }
    }
}

/// The map of a file's bytes, and median milliseconds to read it.
fn timed_reading(bytes: &[u8], config: MapConfig) -> anyhow::Result<(OctreeMap, f64)> {
    let (mut map, mut times) = (None, Vec::new());
    for _ in 0..ROUNDS {
        drop(map.take());
        let start = thread_ms();
        map = Some(OctreeMap::read(bytes, Path::new("map"), config)?);
        times.push(thread_ms() - start);
    }
    Ok((map.context("nothing was read")?, median(&times)))
}

/// Median milliseconds of a few rounds.
fn timed(mut work: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = Vec::with_capacity(MANY_ROUNDS);
    while times.len() < ROUNDS || times.len() < MANY_ROUNDS && times.last().is_some_and(|ms| *ms < SHORT_MS) {
        let start = thread_ms();
        work();
        times.push(thread_ms() - start);
    }
    median(&times)
}

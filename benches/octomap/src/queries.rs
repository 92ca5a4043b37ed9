//! The same questions to our map as `octomap.cpp` asks, in the same order.

use std::fs;
use std::path::Path;

use anyhow::Context as _;
use evac_formats::octomap::{BinaryValues, bt_bytes, ot_bytes, read_bytes};
use evac_octree::{OctreeMap, Pruning};

use crate::clock::thread_ms;
use crate::octomap::Figures;

const CASTS: usize = 2000;
const BOXES: usize = 2000;

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
    let leaves_ms = timed(|| {
        map.for_each_leaf(16, |leaf| {
            leaves += 1;
            sum += f64::from(leaf.log_odds);
        });
    });
    let same = is("leaves", leaves as f64).zip(is("leaves_sum", sum)).map(|(a, b)| a && b);
    rows.push(Row { what: "all leaves", ours: leaves_ms, theirs: "leaves_ms", same });

    let (mut random, mut leaves) = (Lcg(1), 0_u64);
    let boxes_ms = timed(|| {
        for _ in 0..BOXES {
            let low: [f32; 3] = std::array::from_fn(|axis| {
                let reach = if axis == 2 { 2.0 } else { 10.0 };
                (f64::from(at[axis]) + (random.uniform() * 2.0 - 1.0) * reach) as f32
            });
            let space = map.space();
            if let (Some(min), Some(max)) = (space.key(low), space.key(low.map(|axis| axis + 1.0))) {
                map.for_each_leaf_in(min, max, |_| leaves += 1);
            }
        }
    });
    // OctoMap tells leaves above a brick as one, so the numbers differ.
    rows.push(Row { what: "2000 boxes of 1 m", ours: boxes_ms, theirs: "boxes_ms", same: None });

    let (mut random, mut hits, mut sum) = (Lcg(2), 0_u64, 0.0);
    let casts_ms = timed(|| {
        for _ in 0..CASTS {
            let mut direction: [f32; 3] = std::array::from_fn(|_| (random.uniform() * 2.0 - 1.0) as f32);
            direction[2] *= 0.25;
            let cast = map.cast_ray(at, direction, true, Some(max_range));
            if let Some(cast) = cast.filter(|cast| cast.hit) {
                hits += 1;
                sum += f64::from(cast.end[0] + cast.end[1] + cast.end[2]);
            }
        }
    });
    let same = is("casts", hits as f64).zip(is("casts_sum", sum)).map(|(a, b)| a && b);
    rows.push(Row { what: "2000 rays", ours: casts_ms, theirs: "casts_ms", same });

    let (tree, prune_ms) = timed_value(|| map.to_tree(Pruning::Full));
    rows.push(Row {
        what: "prune (ours: build the pruned tree)",
        ours: prune_ms,
        theirs: "prune_ms",
        same: None,
    });
    let (bytes, write_ms) = timed_value(|| ot_bytes(&map.to_tree(Pruning::Full)));
    rows.push(Row { what: "write .ot", ours: write_ms, theirs: "write_ot_ms", same: None });
    let (read, read_ms) = timed_value(|| read_map(&bytes, map));
    let same = Some(ot_bytes(&read?.to_tree(Pruning::Full)) == bytes);
    rows.push(Row { what: "read .ot", ours: read_ms, theirs: "read_ot_ms", same });
    let values = map.sensor().binary_values();
    let (bytes, write_ms) = timed_value(|| bt_bytes(&map.to_tree(Pruning::Full), &values));
    rows.push(Row {
        what: "write .bt",
        ours: write_ms,
        theirs: "write_bt_ms",
        same: file("map.bt", &bytes)?,
    });
    let (read, read_ms) = timed_value(|| read_map(&bytes, map));
    read?;
    rows.push(Row { what: "read .bt", ours: read_ms, theirs: "read_bt_ms", same: None });

    let mut merged = OctreeMap::from_tree(&tree, *map.sensor(), 4 << 30)?;
    let (report, merge_ms) = timed_value(|| merged.merge(map));
    report?;
    let same = file("merged.ot", &ot_bytes(&merged.to_tree(Pruning::Full)))?;
    rows.push(Row { what: "merge with itself", ours: merge_ms, theirs: "merge_ms", same });

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

fn read_map(bytes: &[u8], like: &OctreeMap) -> anyhow::Result<OctreeMap> {
    let tree = read_bytes(bytes, Path::new("map"), &BinaryValues::default())?;
    OctreeMap::from_tree(&tree, *like.sensor(), 4 << 30).context("the file's map is too large")
}

fn timed(work: impl FnOnce()) -> f64 {
    timed_value(work).1
}

fn timed_value<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = thread_ms();
    let value = work();
    (value, thread_ms() - start)
}

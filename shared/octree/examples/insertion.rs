//! Measures scan insertion, in processor time, on a synthetic hall: `cargo run --release -p evac-octree --example insertion`.

use std::time::Instant;

use evac_octree::{MapConfig, MapError, OctreeMap, Pruning, Scan, ScanOptions};

/// Half the size of the hall, metres.
const HALL: [f32; 3] = [30.0, 18.0, 4.0];

fn main() -> Result<(), MapError> {
    println!(
        "points  metres  discretize  median ms  max ms  Mpoints/s  Mvoxels/scan  changed  map MiB  tree ms"
    );
    for (points, resolution) in [(24_000, 0.2), (24_000, 0.1), (10_000, 0.1), (10_000, 0.05)] {
        for discretize in [false, true] {
            run(points, resolution, discretize)?;
        }
    }
    Ok(())
}

fn run(points: usize, resolution: f64, discretize: bool) -> Result<(), MapError> {
    let mut map = OctreeMap::new(MapConfig::new(resolution))?;
    let options = ScanOptions { max_range: Some(40.0), discretize, ..ScanOptions::default() };
    let (mut times, mut voxels, mut changed) = (Vec::new(), 0, 0);
    let begin = Instant::now();
    for step in 0..15 {
        let origin = [step as f32 * 0.8 - 6.0, (step as f32 * 0.7).sin(), 0.2];
        let hits = scan(points, step, origin);
        let start = cpu_ms(begin);
        let report = map.insert_scan(&Scan { origin, hits: &hits, ..Scan::default() }, &options);
        times.push(cpu_ms(begin) - start);
        voxels += report.free_voxels + report.occupied_voxels;
        changed += report.changed;
    }
    times.sort_by(f64::total_cmp);
    let start = cpu_ms(begin);
    let tree = map.to_tree(Pruning::Full);
    println!(
        "{points:6}  {resolution:6}  {discretize:10}  {:9.2}  {:6.2}  {:9.2}  {:12.3}  {:7}  {:7.1}  {:7.1} ({} nodes)",
        times[7],
        times[14],
        points as f64 / times[7] / 1e3,
        f64::from(voxels) / 15e6,
        changed / 15,
        map.memory_bytes() as f64 / f64::from(1 << 20),
        cpu_ms(begin) - start,
        tree.nodes().len(),
    );
    Ok(())
}

/// Milliseconds of processor time that this thread has had, so that a busy machine says nearly the same; of wall clock
/// since `begin` where the system does not tell.
fn cpu_ms(begin: Instant) -> f64 {
    let used = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds =
        used.as_deref().and_then(|text| text.split(' ').next()).and_then(|field| field.parse().ok());
    nanoseconds.map_or_else(|| begin.elapsed().as_secs_f64() * 1e3, |ns: f64| ns / 1e6)
}

/// Rays in all directions from `origin` to the walls of the hall, with a centimetre of roughness.
fn scan(count: usize, step: usize, origin: [f32; 3]) -> Vec<[f32; 3]> {
    (0..count)
        .map(|n| {
            let turn = (n + step * count) as f32 * 2.399_963;
            let height = 2.0 * (n as f32 + 0.5) / count as f32 - 1.0;
            let flat = (1.0 - height * height).sqrt();
            let direction = [flat * turn.cos(), flat * turn.sin(), height];
            let to_wall =
                |axis: usize| (HALL[axis] * direction[axis].signum() - origin[axis]) / direction[axis];
            let length = to_wall(0).min(to_wall(1)).min(to_wall(2)) + 0.01 * (n as f32 * 12.9898).sin();
            std::array::from_fn(|axis| origin[axis] + length * direction[axis])
        })
        .collect()
}

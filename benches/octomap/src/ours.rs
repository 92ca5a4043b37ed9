//! The same work in our map.

use std::time::Instant;

use evac_octree::{MapConfig, MapError, OcTreeFile, OctreeMap, Pruning, Scan, ScanOptions};

use crate::Case;
use crate::clock::thread_ms;
use crate::scans::Points;

pub(crate) struct Run {
    /// Milliseconds a scan.
    pub(crate) times: Vec<f64>,
    /// The same by the wall clock.
    pub(crate) wall: Vec<f64>,
    pub(crate) checkpoints: Vec<Checkpoint>,
    pub(crate) map: OctreeMap,
}

pub(crate) struct Checkpoint {
    pub(crate) scans: usize,
    /// Held, and of these in use.
    pub(crate) map_bytes: usize,
    pub(crate) used_bytes: usize,
    pub(crate) tree: OcTreeFile,
}

pub(crate) fn run(case: &Case, scans: &[Points]) -> Result<Run, MapError> {
    let mut map = OctreeMap::new(MapConfig {
        max_bytes: 4 << 30,
        threads: case.threads,
        ..MapConfig::new(case.resolution)
    })?;
    let options = ScanOptions {
        max_range: Some(case.max_range),
        discretize: case.discretized,
        coarse_free_space: case.coarse,
        ..ScanOptions::default()
    };
    let (mut times, mut wall, mut checkpoints) = (Vec::with_capacity(scans.len()), Vec::new(), Vec::new());
    for (n, scan) in scans.iter().enumerate() {
        let scan = Scan { origin: scan.origin, hits: &scan.points, ..Scan::default() };
        let (begin, start) = (Instant::now(), thread_ms());
        map.insert_scan(&scan, &options);
        times.push(thread_ms() - start);
        wall.push(begin.elapsed().as_secs_f64() * 1e3);
        if case.checkpoints.contains(&(n + 1)) {
            let tree = map.to_tree(Pruning::Full);
            checkpoints.push(Checkpoint {
                scans: n + 1,
                map_bytes: map.memory_bytes(),
                used_bytes: map.memory_bytes() - map.free_bytes(),
                tree,
            });
        }
    }
    Ok(Run { times, wall, checkpoints, map })
}

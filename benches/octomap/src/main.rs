//! The map beside OctoMap's own library: the same scans into both, files compared byte for byte, processor time per scan,
//! memory and queries, all in one run. See README.md.

mod clock;
mod octomap;
mod ours;
mod queries;
mod scans;

use std::fs;
use std::path::PathBuf;

use anyhow::bail;
use clap::Parser;
use evac_formats::octomap::ot_bytes;

use crate::scans::Sensor;

/// Compares the map with OctoMap on scans of a simulated walk.
#[derive(Parser)]
struct Options {
    /// Edges of a voxel, metres.
    #[arg(long, value_delimiter = ',', default_values_t = [0.2])]
    resolution: Vec<f64>,
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["mid40", "spinning"])]
    sensor: Vec<Sensor>,
    /// Numbers of scans after which the files are compared, ascending.
    #[arg(long, value_delimiter = ',', default_values_t = [20])]
    scans: Vec<usize>,
    /// Takes every n-th frame of the walk (10 Hz, 1.1 m/s).
    #[arg(long, default_value_t = 1)]
    stride: usize,
    /// Longest ray, metres.
    #[arg(long, default_value_t = 40.0)]
    max_range: f64,
    /// One ray to the centre of each end voxel (OctoMap: lazy and discretize).
    #[arg(long)]
    discretized: bool,
    /// Clears in blocks of 4 x 4 x 4 voxels, which OctoMap cannot: files differ.
    #[arg(long)]
    coarse: bool,
    /// Threads that insert a scan into our map. Times are those of the calling thread.
    #[arg(long, default_value_t = 1)]
    threads: u32,
    /// Fails where a file differs from OctoMap's.
    #[arg(long)]
    check: bool,
    /// Runs without OctoMap: only our figures.
    #[arg(long)]
    alone: bool,
    /// Asks the last map nothing: OctoMap's tree without pruning, which two of the questions begin with, may need gigabytes.
    #[arg(long)]
    no_queries: bool,
    /// Keeps OctoMap's maps and figures in this folder, and uses those that are there: it may take an hour for them.
    #[arg(long)]
    keep: Option<PathBuf>,
}

/// One line of the table.
struct Case {
    sensor: Sensor,
    resolution: f64,
    max_range: f64,
    discretized: bool,
    checkpoints: Vec<usize>,
    threads: u32,
    coarse: bool,
    no_queries: bool,
}

impl Case {
    /// Whether the last map is asked.
    fn queries(&self) -> bool {
        !self.discretized && !self.coarse && !self.no_queries
    }
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    let compare = octomap::is_built() && !options.alone;
    if !octomap::is_built() {
        println!("skipped: no comparison with OctoMap, its library was not found (Debian: liboctomap-dev)");
    }
    println!(
        "processor time; one thread; max range {} m; every {}th frame",
        options.max_range, options.stride
    );
    for &sensor in &options.sensor {
        let count = options.scans.iter().copied().max().unwrap_or(0);
        let scans = scans::record(sensor, count, options.stride)?;
        let folder = tempfile::tempdir()?;
        let file = folder.path().join("scans");
        scans::write(&scans, &file)?;
        for &resolution in &options.resolution {
            let case = Case {
                sensor,
                resolution,
                max_range: options.max_range,
                discretized: options.discretized,
                checkpoints: options.scans.clone(),
                threads: options.threads,
                coarse: options.coarse,
                no_queries: options.no_queries,
            };
            let name = format!(
                "{sensor:?}-{resolution}-{}-{}-{}-{:?}",
                options.max_range,
                if case.discretized { "discretized" } else { "exact" },
                options.stride,
                case.checkpoints,
            );
            let maps = options.keep.as_deref().unwrap_or(folder.path()).join(name);
            let same = run(&case, &scans, compare, &file, &maps)?;
            if options.check && !same {
                bail!("a file differs from OctoMap's");
            }
        }
    }
    Ok(())
}

fn run(
    case: &Case,
    scans: &[scans::Points],
    compare: bool,
    file: &std::path::Path,
    folder: &std::path::Path,
) -> anyhow::Result<bool> {
    let mut all_same = true;
    let ours = ours::run(case, scans)?;
    let theirs = if compare { Some(octomap::run(case, file, folder)?) } else { None };
    let their_times = theirs.as_ref().map(|figures| figures.all("scan_ms")).unwrap_or_default();
    for (n, checkpoint) in ours.checkpoints.iter().enumerate() {
        let count = checkpoint.scans;
        let our_median = clock::median(&ours.times[..count]);
        print!(
            "{:?} {} m, {}, {count} scans of {} points: {our_median:.2} ms (wall {:.2}), first {:.2} ms, map {:.2} MiB ({:.2} in use)",
            case.sensor,
            case.resolution,
            if case.discretized { "discretized" } else { "exact" },
            scans.iter().map(|scan| scan.points.len()).sum::<usize>() / scans.len().max(1),
            clock::median(&ours.wall[..count]),
            ours.times.first().copied().unwrap_or(0.0),
            mib(checkpoint.map_bytes as f64),
            mib(checkpoint.used_bytes as f64),
        );
        if let Some(figures) = &theirs {
            let times = &their_times[..count.min(their_times.len())];
            let median = clock::median(times);
            let sum_ratio = times.iter().sum::<f64>() / ours.times[..count].iter().sum::<f64>();
            let heap = figures.all("heap_bytes").get(n).copied().unwrap_or(f64::NAN);
            let usage = figures.all("memory_usage").get(n).copied().unwrap_or(f64::NAN);
            let same = fs::read(folder.join(format!("{count}.ot")))? == ot_bytes(&checkpoint.tree);
            all_same &= same;
            print!(
                "; OctoMap {median:.1} ms, first {:.1} ms, heap {:.1} MiB, memoryUsage {:.1} MiB; ratio of medians {:.1}, of sums {sum_ratio:.1}, of first {:.1}, of heaps {:.1}; .ot {}",
                times[0],
                mib(heap),
                mib(usage),
                median / our_median,
                times[0] / ours.times[0],
                heap / checkpoint.map_bytes as f64,
                if same { "equal" } else { "DIFFERENT" },
            );
        }
        println!();
    }
    match scans.last() {
        Some(last) if case.queries() => {
            let count = scans.len();
            Ok(all_same
                & queries::compare(&ours.map, last.origin, case.max_range, count, theirs.as_ref(), folder)?)
        }
        _ => Ok(all_same),
    }
}

fn mib(bytes: f64) -> f64 {
    bytes / f64::from(1 << 20)
}

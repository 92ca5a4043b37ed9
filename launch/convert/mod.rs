//! `evac convert`: a point cloud into octree files, voxel centres and flat maps.

mod cli;
pub(crate) mod flat_map;
pub(crate) mod output;
pub(crate) mod source;
mod tiles;

use std::time::Instant;

use evac_formats::pcd::WriteAs;
use evac_octree::MapConfig;
use evac_octree_mapper::{CloudFilter, CloudFilterError, CloudMap, CloudSource, Removed, Verdict};
use evac_stage::RunError;

pub(crate) use cli::{CONVERT_HELP, ConvertArgs};
use flat_map::FlatMap;
use output::Output;
use source::FileSource;

use crate::error::LaunchError;

/// `evac convert CLOUD --resolution R [FILTERS] -o FILE...`.
pub(crate) fn convert(args: &ConvertArgs) -> Result<(), LaunchError> {
    let outputs = args.output.iter().map(|path| Output::of(path)).collect::<Result<Vec<_>, _>>()?;
    if !(args.resolution.is_finite() && (0.001..=100.0).contains(&args.resolution)) {
        return Err(usage(format!("--resolution {} must be 0.001 to 100 metres", args.resolution)));
    }
    let band = match args.band.as_slice() {
        &[low, high] if low < high => [low, high],
        band => return Err(usage(format!("--band {band:?} must be two heights, the lower one first"))),
    };
    let started = Instant::now();
    let flat = FlatMap { band, storey: args.storey };
    let config = args.filters.config(args.resolution, outputs.iter().any(|output| output.is_flat()));
    let filter = CloudFilter::new(config).map_err(usage)?;
    let again = config.outliers.is_some() || config.ground.is_some();
    let mut source = FileSource::new(args.cloud.clone(), args.filters.origin(), again);
    let max_bytes = args.max_map_mib as usize * (1 << 20);
    let map_config = MapConfig { max_bytes, ..MapConfig::new(args.resolution) };
    let mut cloud = CloudMap::new(map_config).map_err(|cause| usage(cause.to_string()))?;
    let removed = fill(&mut cloud, &filter, &mut source, args.filters.remove_ground)?;
    let write_as = if args.binary { WriteAs::Binary } else { WriteAs::Ascii };
    for (path, output) in args.output.iter().zip(&outputs) {
        output.write(path, &cloud.map, &flat, write_as)?;
        println!("{}", path.display());
    }
    report(args, &cloud, &removed, &source, started);
    complain(&cloud, &removed, &source)
}

/// Reads, filters and inserts a cloud; ground that is not to be removed is an obstacle and flagged.
pub(crate) fn fill<S: CloudSource>(
    cloud: &mut CloudMap,
    filter: &CloudFilter,
    source: &mut S,
    remove_ground: bool,
) -> Result<Removed, LaunchError>
where
    LaunchError: From<S::Error>,
{
    let visit = |point, verdict| {
        if verdict == Verdict::Ground {
            cloud.ground(point);
        }
        if verdict == Verdict::Kept || !remove_ground {
            cloud.hit(point);
        }
    };
    filter.run(source, visit).map_err(|error| match error {
        CloudFilterError::Source(cause) => cause.into(),
        CloudFilterError::TooLarge { filter, most, remedy } => LaunchError::Silent(format!(
            "the {filter} filter needs more than {most} places in memory; {remedy}"
        )),
    })
}

fn report(args: &ConvertArgs, cloud: &CloudMap, removed: &Removed, source: &FileSource, started: Instant) {
    let Removed { not_finite, outside, unreachable, outliers, ground, .. } = removed;
    let ground_is = if args.filters.remove_ground { "ground removed" } else { "ground" };
    println!(
        "{} points in {} passes: {not_finite} not finite, {outside} outside the limits, {unreachable} beyond the keys, \
         {outliers} outliers, {ground} {ground_is}, {} in the map, {} beyond the memory limit",
        source.points(),
        source.passes(),
        cloud.hits,
        cloud.full,
    );
    println!(
        "{} voxels of {} m, {:.2} s{}",
        cloud.map.known(),
        args.resolution,
        started.elapsed().as_secs_f64(),
        peak_mib().map_or(String::new(), |mib| format!(", at most {mib} MiB")),
    );
}

/// Says what is wrong with a result that was written.
fn complain(cloud: &CloudMap, removed: &Removed, source: &FileSource) -> Result<(), LaunchError> {
    if cloud.full > 0 {
        return Err(LaunchError::Silent(format!(
            "{} points did not fit into the map; use a coarser --resolution or more --max-map-mib",
            cloud.full
        )));
    }
    if removed.unreachable > 0 {
        let [x, y, z] = source.first().unwrap_or_default().map(f32::round);
        return Err(LaunchError::Silent(format!(
            "{} points lie beyond 32768 voxels from the origin; take one off, for example --origin {x} {y} {z}",
            removed.unreachable
        )));
    }
    Ok(())
}

/// The most memory that this process has had, where the system says it.
fn peak_mib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib / 1024)
}

fn usage(cause: String) -> LaunchError {
    LaunchError::Run(RunError::Value(cause))
}

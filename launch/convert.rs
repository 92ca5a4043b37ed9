//! `evac convert`: a point cloud into an octree file.

use std::time::Instant;

use evac_formats::{octomap, pcd};
use evac_octree::{MapConfig, Pruning};
use evac_octree_mapper::{GroundConfig, map_of_cloud, remove_ground};
use evac_stage::RunError;

use crate::cli::ConvertArgs;
use crate::error::LaunchError;
use crate::progress::bar;

/// Points between two steps of the progress bar.
const STEP: u64 = 65_536;

enum Output {
    Binary,
    Full,
}

/// `evac convert CLOUD.pcd --resolution R [--remove-ground] -o MAP.bt|MAP.ot`.
pub(crate) fn convert(args: &ConvertArgs) -> Result<(), LaunchError> {
    let usage = |cause: String| LaunchError::Run(RunError::Value(cause));
    let output = match args.output.extension().and_then(|extension| extension.to_str()) {
        Some("bt") => Output::Binary,
        Some("ot") => Output::Full,
        _ => {
            let name = args.output.display();
            return Err(usage(format!(
                "{name}: the output's name must end in .bt (occupancy) or .ot (log-odds)"
            )));
        }
    };
    if !(args.resolution.is_finite() && (0.001..=100.0).contains(&args.resolution)) {
        return Err(usage(format!("--resolution {} must be 0.001 to 100 metres", args.resolution)));
    }
    let started = Instant::now();
    let reader = pcd::Reader::open(&args.cloud)?;
    let bar = bar(reader.header().points, "points");
    let mut failure = None;
    let mut read = 0_u64;
    let points = reader.map_while(|point| match point {
        Ok(point) => {
            read += 1;
            if read.is_multiple_of(STEP) {
                bar.set_position(read);
            }
            Some([point.x, point.y, point.z])
        }
        Err(error) => {
            failure = Some(error);
            None
        }
    });
    let config = MapConfig::new(args.resolution);
    let bad_map = |cause: evac_octree::MapError| usage(cause.to_string());
    let (cloud, ground) = if args.remove_ground {
        // The ground of all levels can only be told when the whole cloud is known.
        let mut points: Vec<_> = points.collect();
        let ground = remove_ground(&mut points, &GroundConfig::default()).map_err(usage)?;
        (map_of_cloud(points, config).map_err(bad_map)?, ground)
    } else {
        (map_of_cloud(points, config).map_err(bad_map)?, 0)
    };
    bar.finish_and_clear();
    if let Some(error) = failure {
        return Err(error.into());
    }
    let tree = cloud.map.to_tree(Pruning::Full);
    match output {
        Output::Full => octomap::write_ot(&args.output, &tree)?,
        Output::Binary => octomap::write_bt(&args.output, &tree, &cloud.map.sensor().binary_values())?,
    }
    println!(
        "{}: {read} points ({ground} ground, {} not finite, {} outside, {} beyond the memory limit), {} voxels of {} m, {:.2} s",
        args.output.display(),
        cloud.not_finite,
        cloud.outside,
        cloud.full,
        cloud.map.known(),
        args.resolution,
        started.elapsed().as_secs_f64()
    );
    if cloud.full > 0 {
        return Err(LaunchError::Silent(format!(
            "{}: {} points did not fit into the map; use a coarser --resolution",
            args.output.display(),
            cloud.full
        )));
    }
    Ok(())
}

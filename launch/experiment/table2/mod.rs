//! `evac experiment table2`: the paper's Table 2, what a cloud of a station becomes at three resolutions with its ground and
//! without.

mod cloud;
mod picture;

use std::path::{Path, PathBuf};
use std::time::Instant;

use evac_formats::cloud::{Intensity, Reader};
use evac_formats::octomap;
use evac_formats::pcd::{self, WriteAs};
use evac_octree::{MapConfig, Pruning};
use evac_octree_mapper::{BoundsConfig, CloudFilter, CloudFilterConfig, CloudMap, GroundConfig, Removed};
use serde::Serialize;
use serde_json::json;

use super::cli::Table2Args;
use super::{usage, write_text};
use crate::convert::fill;
use crate::convert::output::write_centres;
use crate::convert::source::FileSource;
use crate::error::LaunchError;
use crate::finite::create_folder;
use picture::Panel;

/// The paper's table has 0.8 m where its text has 0.6 m; the numbers of its voxels fit 0.8 m.
const RESOLUTIONS_M: [f64; 3] = [0.2, 0.4, 0.8];

/// One of the six conditions.
#[derive(Debug, Serialize)]
struct Condition {
    ground_removed: bool,
    resolution_m: f64,
    /// From the binary PCD on disk to the `.bt` on disk.
    conversion_s: f64,
    points: u64,
    voxels: usize,
    bt_bytes: u64,
    ot_bytes: u64,
    /// The occupied voxels' centres as text.
    pcd_bytes: u64,
    #[serde(skip)]
    panel: Panel,
}

/// The cloud that is converted.
struct Cloud {
    path: PathBuf,
    points: u64,
    /// As it is on disk, and as text.
    bytes: u64,
    ascii_bytes: u64,
    from: String,
}

pub(super) fn table2(args: &Table2Args) -> Result<(), LaunchError> {
    create_folder(&args.output)?;
    let cloud = prepare(args)?;
    let mut conditions = Vec::new();
    for ground_removed in [true, false] {
        for resolution in RESOLUTIONS_M {
            conditions.push(convert(args, &cloud, ground_removed, resolution)?);
        }
    }
    let table = table(&cloud, &conditions);
    println!("{table}");
    let markdown = format!("`evac experiment table2`, {}\n\n{table}", cloud.from);
    let whole = json!({
        "evac": env!("CARGO_PKG_VERSION"),
        "cloud": cloud.from,
        "points": cloud.points,
        "pcd_bytes": cloud.bytes,
        "ascii_pcd_bytes": cloud.ascii_bytes,
        "conditions": conditions,
    });
    write_text(&args.output.join("table2.md"), &markdown)?;
    write_text(&args.output.join("table2.json"), &format!("{whole:#}\n"))?;
    let panels: Vec<(String, &Panel)> = conditions
        .iter()
        .map(|condition| (format!("{} m, {}", condition.resolution_m, words(condition)), &condition.panel))
        .collect();
    let path = args.output.join("maps.png");
    picture::draw(&panels).write_png(&path)?;
    println!("{}", path.display());
    Ok(())
}

/// The cloud of a file, or one of a simulated walk, as a binary PCD file.
fn prepare(args: &Table2Args) -> Result<Cloud, LaunchError> {
    let path = args.output.join("cloud.pcd");
    let points = match &args.cloud {
        Some(file) => Reader::open(file, [0.0; 3])?.collect::<Result<Vec<_>, _>>()?,
        None => cloud::of_walk(args.seed).map_err(|cause| usage(cause.to_string()))?,
    };
    let from = match &args.cloud {
        Some(file) => format!("the cloud {}", file.file_name().unwrap_or_default().display()),
        None => format!("a simulated walk through the station hall, seed {}", args.seed),
    };
    pcd::write(&path, points.iter().copied(), Intensity::Dropped, WriteAs::Binary)?;
    let text = args.output.join("cloud-ascii.pcd");
    pcd::write(&text, points.iter().copied(), Intensity::Dropped, WriteAs::Ascii)?;
    let cloud =
        Cloud { points: points.len() as u64, bytes: size(&path)?, ascii_bytes: size(&text)?, path, from };
    std::fs::remove_file(&text).map_err(|cause| LaunchError::Path(format!("{}: {cause}", text.display())))?;
    Ok(cloud)
}

fn convert(
    args: &Table2Args,
    cloud: &Cloud,
    ground_removed: bool,
    resolution: f64,
) -> Result<Condition, LaunchError> {
    let name = format!("{}-{resolution}", if ground_removed { "ground-removed" } else { "ground-kept" });
    let [bt, ot, centres] = ["bt", "ot", "pcd"].map(|kind| args.output.join(format!("{name}.{kind}")));
    let started = Instant::now();
    let filter = CloudFilter::new(CloudFilterConfig {
        outliers: None,
        bounds: BoundsConfig::default(),
        ground: ground_removed.then(GroundConfig::default),
        reach_m: 32_768.0 * resolution,
    })
    .map_err(usage)?;
    let mut source = FileSource::new(cloud.path.clone(), [0.0; 3], ground_removed);
    let mut map = CloudMap::new(MapConfig::new(resolution)).map_err(|cause| usage(cause.to_string()))?;
    let removed: Removed = fill(&mut map, &filter, &mut source, ground_removed)?;
    let tree = map.map.to_tree(Pruning::Full);
    octomap::write_bt(&bt, &tree, &map.map.sensor().binary_values())?;
    let conversion_s = started.elapsed().as_secs_f64();
    octomap::write_ot(&ot, &tree)?;
    write_centres(&centres, &map.map, WriteAs::Ascii)?;
    Ok(Condition {
        ground_removed,
        resolution_m: resolution,
        conversion_s,
        points: removed.kept + if ground_removed { 0 } else { removed.ground },
        voxels: map.map.known(),
        bt_bytes: size(&bt)?,
        ot_bytes: size(&ot)?,
        pcd_bytes: size(&centres)?,
        panel: Panel::of(&map.map),
    })
}

fn words(condition: &Condition) -> &'static str {
    if condition.ground_removed { "ground removed" } else { "ground kept" }
}

fn table(cloud: &Cloud, conditions: &[Condition]) -> String {
    let mut text = format!(
        "{} points; PCD {} B as text, {} B binary. Ratios are to the PCD file as text, as in the paper.\n\n",
        cloud.points, cloud.ascii_bytes, cloud.bytes
    );
    text += "| condition | conversion, s | points | voxels | .bt, B | ratio | .ot, B | ratio | voxels as PCD text, B | ratio |\n";
    text += "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n";
    for condition in conditions {
        let ratio = |bytes: u64| format!("{:.2} %", 100.0 * bytes as f64 / cloud.ascii_bytes as f64);
        let Condition { bt_bytes, ot_bytes, pcd_bytes, .. } = *condition;
        text += &format!(
            "| {} m, {} | {:.2} | {} | {} | {bt_bytes} | {} | {ot_bytes} | {} | {pcd_bytes} | {} |\n",
            condition.resolution_m,
            words(condition),
            condition.conversion_s,
            condition.points,
            condition.voxels,
            ratio(bt_bytes),
            ratio(ot_bytes),
            ratio(pcd_bytes),
        );
    }
    text
}

fn size(path: &Path) -> Result<u64, LaunchError> {
    let metadata = std::fs::metadata(path);
    metadata.map(|file| file.len()).map_err(|cause| LaunchError::Path(format!("{}: {cause}", path.display())))
}

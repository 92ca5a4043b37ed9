//! The command line of `evac convert`.

use std::path::PathBuf;

use clap::Args;
use evac_octree_mapper::{BoundsConfig, CloudFilterConfig, CloudOutlierConfig, GroundConfig};

#[derive(Debug, Args)]
pub(crate) struct ConvertArgs {
    /// Point cloud: PCD (ascii, binary, compressed), PLY (ascii, binary) or LAS/LAZ, told by its contents
    #[arg(value_name = "CLOUD")]
    pub(super) cloud: PathBuf,
    /// Edge of a voxel, metres
    #[arg(short, long, value_name = "METRES")]
    pub(super) resolution: f64,
    /// File to write, told by its name: .bt, .ot, .pcd, .pgm or .yaml, .png; may be given several times
    #[arg(short, long, value_name = "FILE", required = true)]
    pub(super) output: Vec<PathBuf>,
    #[command(flatten)]
    pub(super) filters: FilterArgs,
    /// Write .pcd in binary [default: as text, which is what the paper's file sizes are of]
    #[arg(long)]
    pub(super) binary: bool,
    /// Heights above the local ground between which something is an obstacle on the flat map, metres
    #[arg(long, num_args = 2, value_names = ["LOW", "HIGH"], default_values_t = [0.2, 1.8])]
    pub(super) band: Vec<f64>,
    /// Height of the storey that the flat map shows, metres [default: the one with most ground]
    #[arg(long, value_name = "Z", allow_negative_numbers = true)]
    pub(super) storey: Option<f64>,
    /// Most memory that the map may take, MiB
    #[arg(long, value_name = "MIB", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub(super) max_map_mib: u32,
}

/// Which points go into the map (paper section 3.1).
#[derive(Debug, Args)]
pub(crate) struct FilterArgs {
    /// Leave out points with fewer others within this radius than --neighbours says, metres
    #[arg(long, value_name = "METRES")]
    outlier_radius: Option<f64>,
    /// Others within --outlier-radius that keep a point
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=254))]
    neighbours: u8,
    /// Leave out what is lower or higher, metres
    #[arg(long, num_args = 2, value_names = ["LOW", "HIGH"], allow_negative_numbers = true)]
    x: Option<Vec<f64>>,
    /// The same along y
    #[arg(long, num_args = 2, value_names = ["LOW", "HIGH"], allow_negative_numbers = true)]
    y: Option<Vec<f64>>,
    /// The same along z
    #[arg(long, num_args = 2, value_names = ["LOW", "HIGH"], allow_negative_numbers = true)]
    z: Option<Vec<f64>>,
    /// Leave the ground of all levels out (z must be against gravity)
    #[arg(long)]
    pub(super) remove_ground: bool,
    /// Take this off all coordinates first, metres; for clouds in a map projection
    #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], allow_negative_numbers = true)]
    origin: Option<Vec<f64>>,
}

impl FilterArgs {
    pub(super) fn origin(&self) -> [f64; 3] {
        match self.origin.as_deref() {
            Some(&[x, y, z]) => [x, y, z],
            _ => [0.0; 3],
        }
    }

    /// The filters for voxels of `resolution`; `find_ground` where ground must be known though it stays.
    pub(super) fn config(&self, resolution: f64, find_ground: bool) -> CloudFilterConfig {
        let limits = |limits: &Option<Vec<f64>>| match limits.as_deref() {
            Some(&[low, high]) => Some([low, high]),
            _ => None,
        };
        CloudFilterConfig {
            outliers: self
                .outlier_radius
                .map(|radius_m| CloudOutlierConfig { radius_m, min_neighbours: self.neighbours }),
            bounds: BoundsConfig {
                x_m: limits(&self.x),
                y_m: limits(&self.y),
                z_m: limits(&self.z),
                ..BoundsConfig::default()
            },
            ground: (self.remove_ground || find_ground).then(GroundConfig::default),
            reach_m: 32_768.0 * resolution,
        }
    }
}

pub(crate) const CONVERT_HELP: &str = "Files:\n  \
    MAP.bt      OctoMap, two bits a voxel: occupied or free\n  \
    MAP.ot      OctoMap, with log-odds\n  \
    MAP.pcd     centres of the occupied voxels\n  \
    PLAN.pgm    flat map with PLAN.yaml, as nav2 and ROS 1's map_server load it: obstacles of --band above the local\n              \
    ground are occupied, other seen ground is free, all else unknown\n  \
    PLAN.png    the same as a picture\n\n\
    The cloud is read once, and again for each filter that must know a point's surroundings; it is not held in memory\n\
    (but for clouds of up to 8 million points, and PCD's binary_compressed, which is one block).";

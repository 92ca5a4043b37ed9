//! A stage of one's own: `lidar/scan` in, `scan/deskewed` out, one point a voxel, the motion left in the scan. It stands in
//! for the deskewer and can be swapped in and out while the robot walks:
//!
//!     cargo build --release --example thin_scans
//!     evac swap deskewer --run target/release/examples/thin_scans
//!
//! examples/README.md says step by step what is what.

use std::collections::HashSet;
use std::process::ExitCode;

use evac_frames::Point;
use evac_stage::joins::RawScanWithImu;
use evac_stage::{Counters, Rig, ScanOutput, ScanWithImu, Stage, StageConfig, StageError, stage_main};
use serde::{Deserialize, Serialize};

fn main() -> ExitCode {
    stage_main::<ThinScans, RawScanWithImu>(std::env::args_os())
}

/// Read from the deskewer's table of the pipeline file, so it has some of that one's keys; the rest is not for this stage.
#[derive(Debug, Serialize, Deserialize)]
#[serde(default)]
struct Config {
    /// Nearer returns are dropped, metres.
    min_range_m: f32,
    /// Farther returns are dropped, metres.
    max_range_m: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { min_range_m: 0.3, max_range_m: 260.0 }
    }
}

impl StageConfig for Config {
    fn check(&self) -> Result<(), String> {
        let fits = self.min_range_m >= 0.0 && self.min_range_m < self.max_range_m;
        fits.then_some(())
            .ok_or_else(|| format!("min_range_m = {} must be below max_range_m", self.min_range_m))
    }
}

/// Edge of a voxel, metres.
const VOXEL: f32 = 0.02;

struct ThinScans {
    config: Config,
    /// Voxels that have their point; kept, so that its memory is.
    taken: HashSet<[i32; 3]>,
    kept: Vec<Point>,
}

impl Stage for ThinScans {
    const NAME: &'static str = "deskewer";
    type Config = Config;
    type Input<'a> = ScanWithImu<'a>;
    type Output = ScanOutput;

    fn new(config: Config, _rig: &Rig) -> Result<Self, StageError> {
        Ok(Self { config, taken: HashSet::new(), kept: Vec::new() })
    }

    fn process(
        &mut self,
        input: ScanWithImu<'_>,
        output: &mut ScanOutput,
        counters: &mut Counters,
    ) -> Result<(), StageError> {
        self.taken.clear();
        self.kept.clear();
        let mut header = *input.header;
        for point in input.points {
            let range = (point.x * point.x + point.y * point.y + point.z * point.z).sqrt();
            // Nothing that is not finite is within.
            if !(self.config.min_range_m..=self.config.max_range_m).contains(&range) {
                header.rejected += u32::from(point.is_return());
                counters.rejected += u64::from(point.is_return());
                continue;
            }
            let voxel = [point.x, point.y, point.z].map(|metres| (metres / VOXEL).floor() as i32);
            if self.taken.insert(voxel) {
                self.kept.push(*point);
            }
        }
        output.publish(&header, self.kept.len(), |index| self.kept[index])
    }
}

//! The odometry `loam` as a process of its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    evac_stage::stage_main::<evac_odometry::Loam, evac_stage::joins::DeskewedScanWithImu>(std::env::args_os())
}

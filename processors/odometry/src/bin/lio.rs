//! The odometry `lio` as a process of its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    evac_stage::stage_main::<evac_odometry::Lio, evac_stage::joins::DeskewedScanWithImu>(std::env::args_os())
}

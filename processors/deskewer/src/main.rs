//! The deskewer as a process of its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    evac_stage::stage_main::<evac_deskewer::Deskewer, evac_stage::joins::RawScanWithImu>(std::env::args_os())
}

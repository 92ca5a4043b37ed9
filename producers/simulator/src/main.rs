//! The simulator as a process of its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    evac_stage::source_main::<evac_simulator::Simulator>(std::env::args_os())
}

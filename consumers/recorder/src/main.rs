//! The recorder as a process of its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    evac_stage::stage_main::<evac_recorder::Recorder, evac_stage::joins::TapJoin>(std::env::args_os())
}

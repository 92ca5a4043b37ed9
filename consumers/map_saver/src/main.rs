//! The map saver as a process of its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    evac_stage::stage_main::<evac_map_saver::MapSaver, evac_stage::joins::SinkJoin>(std::env::args_os())
}

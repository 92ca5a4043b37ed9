//! The grid exporter as a process of its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    evac_stage::stage_main::<evac_grid_exporter::GridExporter, evac_stage::joins::PlanJoin>(
        std::env::args_os(),
    )
}

//! The octree mapper as a process of its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    evac_stage::stage_main::<evac_octree_mapper::OctreeMapper, evac_stage::joins::ScanPoseJoin>(
        std::env::args_os(),
    )
}

//! The LiDAR's driver as a process of its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    evac_stage::device_main::<evac_lidar::Lidar>(std::env::args_os())
}

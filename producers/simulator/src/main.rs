//! The simulator as a process of its own; with `--as-devices` first, as devices that drivers talk to.

use std::process::ExitCode;

use evac_simulator::Simulator;
use evac_simulator::devices::DeviceSimulator;

fn main() -> ExitCode {
    let mut args: Vec<_> = std::env::args_os().collect();
    if args.get(1).is_some_and(|first| first == "--as-devices") {
        args.remove(1);
        return evac_stage::device_main::<DeviceSimulator>(args);
    }
    evac_stage::source_main::<Simulator>(args)
}

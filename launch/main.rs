//! `evac`: the command that starts, watches and stops pipelines, and every stage in one executable.

mod aftermath;
mod calibrate;
mod chaos;
mod check;
mod child;
mod cli;
mod compare;
mod control;
mod convert;
mod cpu;
mod device_health;
mod devices;
mod doctor;
mod drift;
mod error;
mod eval;
mod experiment;
mod finite;
mod health_board;
mod incidents;
mod live;
mod producer;
mod progress;
mod pulse;
mod recording;
mod registry;
mod restart;
mod services;
mod shadow;
mod silence;
mod slot;
mod status;
mod summary;
mod supervisor;
mod swap;
mod top;
mod trace;
mod usage;
mod view;
mod watch;

use std::process::ExitCode;

use clap::Parser as _;

use crate::cli::{Cli, Command};
use crate::error::LaunchError;

fn main() -> ExitCode {
    let cli = Cli::parse();
    match run(cli.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // A stage that ended with an error has said so itself.
            if !matches!(error, LaunchError::Child { .. }) {
                evac_stage::say_failure("evac", &error);
            }
            ExitCode::from(error.code())
        }
    }
}

fn run(command: Command) -> Result<(), LaunchError> {
    match command {
        Command::Demo(args) => finite::demo(&args),
        Command::Map(args) => finite::map(&args),
        Command::Calibrate(args) => calibrate::calibrate(&args),
        Command::Up(args) => live::up(&args),
        Command::Down(args) => live::down(&args),
        Command::Swap(args) => control::swap(&args),
        Command::Standby(args) => control::standby(&args),
        Command::Shadow(args) => control::shadow(&args),
        Command::Promote(args) => control::promote(&args),
        Command::Compare(args) => compare::compare(&args),
        Command::Top(args) => top::top(&args),
        Command::Trace(args) => trace::trace(&args),
        Command::Status(args) => status::status(&args),
        Command::Check(args) => check::check_file(&args.pipeline),
        Command::Doctor(args) => doctor::doctor(&args),
        Command::Stage(args) => registry::run_stage(&args),
        Command::Services => {
            services::print();
            Ok(())
        }
        Command::Convert(args) => convert::convert(&args),
        Command::Chaos(args) => chaos::chaos(&args),
        Command::Experiment(args) => experiment::experiment(&args),
        Command::Eval(args) => eval::eval(&args),
    }
}

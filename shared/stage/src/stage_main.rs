//! The command line of a stage's own executable, and what is done before it runs.

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Args as _, Command, FromArgMatches as _};

use crate::joins::Join;
use crate::options::Context;
use crate::{RunError, RunOptions, Stage, StageConfig, exit_code, run_stage, start_logging};

/// Runs a stage of its own executable: `main` of every stage crate.
pub fn stage_main<S, J>(args: impl IntoIterator<Item = OsString>) -> ExitCode
where
    J: Join,
    S: for<'a> Stage<Input<'a> = J::Frame<'a>>,
{
    let options = parse_options(S::NAME, args);
    start_logging(&options.log);
    exit_code(S::NAME, run_stage::<S, J>(&options))
}

/// The command line of a stage's own executable; ends the process with code 2 on wrong usage.
pub(crate) fn parse_options(name: &'static str, args: impl IntoIterator<Item = OsString>) -> RunOptions {
    let command = RunOptions::augment_args(Command::new(name).version(env!("CARGO_PKG_VERSION")));
    let matches = command.get_matches_from(args);
    RunOptions::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

/// Handles `--print-config` and `--check`; `None` when the process is done with that.
pub(crate) fn prepare<C: StageConfig>(
    kind: &'static str,
    options: &RunOptions,
) -> Result<Option<(Context, C)>, RunError> {
    let context = options.context(kind)?;
    let config: C = context.config()?;
    if options.print_config {
        print!("{}", context.with_config(&config)?);
        return Ok(None);
    }
    if options.check {
        println!("{}: configuration is valid", context.name);
        return Ok(None);
    }
    if let Some(parent) = options.die_with_parent {
        die_with_parent(parent)?;
    }
    Ok(Some((context, config)))
}

/// Asks the kernel to end this process when the one that started it ends.
fn die_with_parent(parent: u32) -> Result<(), RunError> {
    use rustix::process::{Signal, getppid, set_parent_process_death_signal};
    set_parent_process_death_signal(Some(Signal::TERM))
        .map_err(|cause| RunError::Peer(format!("cannot follow the launcher: {cause}")))?;
    // The launcher may have ended before the request: then somebody else is the parent now. (Not always init, and in a
    // container the launcher may be init.)
    if getppid().is_none_or(|pid| i64::from(pid.as_raw_pid()) != i64::from(parent)) {
        return Err(RunError::Peer("the launcher has ended".to_owned()));
    }
    Ok(())
}

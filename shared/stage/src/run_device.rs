//! The run loop of drivers.

use std::ffi::OsString;
use std::process::ExitCode;
use std::time::Duration;

use evac_config::Mode;
use evac_frames::StageState;
use evac_ports::{Bus, now_ns};

use crate::stage_main::{parse_options, prepare};
use crate::{Device, Reporter, RunError, RunOptions, StageError, StageOutput, exit_code, start_logging};

/// Longest wait for a device, after which reports go out and SIGTERM is looked for.
const PATIENCE: Duration = Duration::from_millis(100);

/// Runs a driver of its own executable: `main` of every driver crate.
pub fn device_main<D: Device>(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let options = parse_options(D::NAME, args);
    start_logging(&options.log);
    exit_code(D::NAME, run_device::<D>(&options))
}

/// Runs a driver until SIGTERM comes.
///
/// # Errors
/// [`RunError`], with the process's exit code in [`RunError::code`].
pub fn run_device<D: Device>(options: &RunOptions) -> Result<(), RunError> {
    let Some((context, config)) = prepare::<D::Config>(D::NAME, options)? else { return Ok(()) };
    if context.mode == Mode::Lossless {
        return Err(RunError::Stage(StageError::Config(format!(
            "mode = \"lossless\" is for recordings and the simulator; with the device '{}' it must be \"live\"",
            context.name
        ))));
    }
    let services = D::services(&config);
    let mut device = D::new(config, &context.rig)?;
    let bus = Bus::join(&context.domain, &context.name)?;
    let mut output = D::Output::open_only(&bus, context.epoch, services)?;
    let mut reporter = Reporter::open(&bus, &context.name, context.epoch)?;
    let served = serve(&mut device, &mut output, &mut reporter, &bus);
    let result = served.and_then(|()| device.finish(&mut output).map_err(RunError::from));
    let (state, reason) = match &result {
        Ok(()) => (StageState::Finished, reporter.noted()),
        Err(error) => (StageState::Failed, error.to_string()),
    };
    // The error itself is what the caller needs to see, not that it could not be reported.
    let reported = reporter.end(state, &reason);
    result.and(reported.map_err(RunError::from))
}

fn serve<D: Device>(
    device: &mut D,
    output: &mut D::Output,
    reporter: &mut Reporter,
    bus: &Bus,
) -> Result<(), RunError> {
    let mut looked_ns = i64::MIN;
    loop {
        let now = now_ns();
        // A system call, nothing for each packet.
        if now.saturating_sub(looked_ns) >= PATIENCE.as_nanos() as i64 / 2 {
            looked_ns = now;
            if bus.stop_requested() {
                return Ok(());
            }
            reporter.report_if_due()?;
        }
        device.serve(output, reporter, PATIENCE)?;
    }
}

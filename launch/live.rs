//! `evac up` and `evac down`: a pipeline on the robot.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use evac_ports::Domain;
use evac_stage::{RunError, start_logging};
use rustix::process::{Pid, Signal, kill_process};

use crate::check::read_checked;
use crate::cli::{DomainArgs, UpArgs};
use crate::error::LaunchError;
use crate::status::{domain_of, nothing_runs};
use crate::supervisor::{Progress, Supervisor, failure_reason, losses};

/// How long `evac down` waits for the launcher to end.
const DOWN_PATIENCE: Duration = Duration::from_secs(200);

/// `evac up PIPELINE.toml`: runs in the foreground until the stream ends, a stage fails, or SIGINT or SIGTERM comes.
pub(crate) fn up(args: &UpArgs) -> Result<(), LaunchError> {
    start_logging(&args.log);
    let pipeline = read_checked(&args.pipeline)?;
    let file = std::path::absolute(&args.pipeline)
        .map_err(|cause| LaunchError::Path(format!("{}: {cause}", args.pipeline.display())))?;
    let name = args.domain.as_deref().or(pipeline.domain.as_deref()).unwrap_or(Domain::DEFAULT);
    let domain = Domain::new(name)?;
    let (mut supervisor, wakeups) = Supervisor::start_lasting(&pipeline, &file, &domain, &args.log)?;
    tracing::info!(domain = name, stages = pipeline.stages.len(), "all stages are up");
    let ended = wakeups.wait(|_| {
        let progress = drain(&mut supervisor);
        match progress {
            Ok(Progress::Running) if supervisor.bus.stop_requested() => ControlFlow::Break(Ok(())),
            Ok(Progress::Running) => ControlFlow::Continue(Duration::from_millis(200)),
            Ok(Progress::Finished) => ControlFlow::Break(Ok(())),
            Err(error) => ControlFlow::Break(Err(error)),
        }
    })?;
    let stopped = supervisor.stop();
    if let Some(reason) = failure_reason(supervisor.board()) {
        tracing::error!(reason, "a stage failed");
    }
    for line in losses(supervisor.board()) {
        tracing::warn!("{line}");
    }
    ended.and(stopped)
}

fn drain(supervisor: &mut Supervisor) -> Result<Progress, LaunchError> {
    while supervisor.take_ack()?.is_some() {}
    supervisor.watch()
}

/// `evac down [PIPELINE.toml]`: stops the launcher of the domain and waits until everything has ended.
pub(crate) fn down(args: &DomainArgs) -> Result<(), LaunchError> {
    let domain = domain_of(args)?;
    let launcher = domain.holder().ok_or_else(|| nothing_runs(&domain))?;
    let pid = i32::try_from(launcher).ok().and_then(Pid::from_raw).ok_or_else(|| nothing_runs(&domain))?;
    kill_process(pid, Signal::TERM).map_err(|cause| {
        LaunchError::Run(RunError::Peer(format!("cannot stop the launcher with pid {launcher}: {cause}")))
    })?;
    let until = Instant::now() + DOWN_PATIENCE;
    while domain.holder().is_some() {
        if Instant::now() > until {
            return Err(LaunchError::Silent(format!(
                "the launcher with pid {launcher} has not ended after {} s; look at `evac status`",
                DOWN_PATIENCE.as_secs()
            )));
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    println!("domain '{}' is down", domain.name());
    Ok(())
}

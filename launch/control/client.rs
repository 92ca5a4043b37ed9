//! `evac swap` and `evac standby`.

use std::io::{BufRead as _, BufReader, Write as _};
use std::os::unix::net::UnixStream;
use std::path::Path;

use evac_ports::Domain;
use evac_stage::RunError;

use super::{Answer, Order, Outcome, Request, socket};
use crate::cli::{PromoteArgs, ShadowArgs, SwapArgs};
use crate::error::LaunchError;
use crate::status::nothing_runs;

/// `evac swap STAGE`.
pub(crate) fn swap(args: &SwapArgs) -> Result<(), LaunchError> {
    ask_and_print(args, Order::Swap)
}

/// `evac standby STAGE`.
pub(crate) fn standby(args: &SwapArgs) -> Result<(), LaunchError> {
    ask_and_print(args, Order::Standby)
}

/// `evac shadow STAGE` and `evac shadow --stop STAGE`.
pub(crate) fn shadow(args: &ShadowArgs) -> Result<(), LaunchError> {
    ask_and_print(&args.swap, if args.stop { Order::Unshadow } else { Order::Shadow })
}

/// `evac promote STAGE`.
pub(crate) fn promote(args: &PromoteArgs) -> Result<(), LaunchError> {
    let PromoteArgs { stage, patience, json, domain } = args.clone();
    let args = SwapArgs { stage, kind: None, run: None, config: None, patience, json, domain };
    ask_and_print(&args, Order::Promote)
}

fn ask_and_print(args: &SwapArgs, order: Order) -> Result<(), LaunchError> {
    let absolute = |path: &Path| {
        std::path::absolute(path).map_err(|cause| LaunchError::Path(format!("{}: {cause}", path.display())))
    };
    let mut run = args.run.clone();
    // The launcher may have been started in another folder.
    if let Some([executable, ..]) = run.as_deref_mut() {
        *executable = absolute(executable)?;
    }
    let request = Request {
        order,
        stage: args.stage.clone(),
        kind: args.kind.clone(),
        run,
        config: args.config.as_deref().map(absolute).transpose()?,
        patience_s: args.patience,
    };
    let domain = Domain::new(args.domain.as_deref().unwrap_or(Domain::DEFAULT))?;
    let outcome = ask(&domain, &request, |text| eprintln!("{text}"))?;
    match serde_json::to_string(&outcome) {
        Ok(json) if args.json => println!("{json}"),
        _ => println!("{}", sentence(order, &outcome)),
    }
    Ok(())
}

/// Asks the domain's launcher and waits for the outcome.
pub(crate) fn ask(
    domain: &Domain,
    request: &Request,
    mut progress: impl FnMut(&str),
) -> Result<Outcome, LaunchError> {
    let broken = |cause: std::io::Error| {
        LaunchError::Run(RunError::Peer(format!("the launcher of domain '{}': {cause}", domain.name())))
    };
    let mut stream = UnixStream::connect(socket(domain)).map_err(|_| nothing_runs(domain))?;
    let line = serde_json::to_string(request).map_err(|cause| broken(cause.into()))?;
    stream.write_all(format!("{line}\n").as_bytes()).map_err(broken)?;
    for line in BufReader::new(stream).lines() {
        let answer: Answer =
            serde_json::from_str(&line.map_err(broken)?).map_err(|cause| broken(cause.into()))?;
        match answer {
            Answer::Progress(text) => progress(&text),
            Answer::Done(outcome) => return Ok(outcome),
            Answer::Stages(_) => {}
            Answer::Failed(cause) => return Err(LaunchError::Silent(cause)),
        }
    }
    Err(LaunchError::Silent("the launcher ended before the request was through".to_owned()))
}

fn sentence(order: Order, outcome: &Outcome) -> String {
    let Outcome { stage, kind, pid, epoch, ready_s, .. } = outcome;
    match (outcome.from_seq, outcome.handover_ms) {
        (Some(seq), Some(ms)) => format!(
            "{stage}: instance {epoch} ({kind}, pid {pid}) leads from frame {seq} on; ready after {ready_s:.1} s, handed over in {ms:.1} ms"
        ),
        _ if order == Order::Unshadow => format!("{stage}: the shadow {epoch} ({kind}, pid {pid}) has ended"),
        _ => {
            let does = if order == Order::Shadow { "goes on as a shadow" } else { "stands by" };
            format!("{stage}: instance {epoch} ({kind}, pid {pid}) {does}; ready after {ready_s:.1} s")
        }
    }
}

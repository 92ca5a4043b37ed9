//! `evac status`.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use evac_config::Pipeline;
use evac_frames::Health;
use evac_ports::{Bus, Domain, Wake, wait_on};
use evac_stage::RunError;
use serde_json::{Map, Value, json};

use crate::cli::{DomainArgs, StatusArgs};
use crate::device_health::device_line;
use crate::error::LaunchError;
use crate::health_board::{HealthBoard, age_s, as_json, odometry_line, state_word};
use crate::incidents::Incidents;

/// Every stage reports once a second.
const PATIENCE: Duration = Duration::from_millis(1300);

/// The domain that a command means.
pub(crate) fn domain_of(args: &DomainArgs) -> Result<Domain, LaunchError> {
    let pipeline = args.pipeline.as_deref().map(Pipeline::read).transpose()?;
    let name = args.domain.clone().or(pipeline.and_then(|pipeline| pipeline.domain));
    Ok(Domain::new(name.as_deref().unwrap_or(Domain::DEFAULT))?)
}

/// Nothing runs in the domain.
pub(crate) fn nothing_runs(domain: &Domain) -> LaunchError {
    LaunchError::Run(RunError::Peer(format!(
        "no pipeline runs in domain '{}'; start one with `evac up` or `evac demo`, or name another --domain",
        domain.name()
    )))
}

/// `evac status [PIPELINE.toml] [--json]`.
pub(crate) fn status(args: &StatusArgs) -> Result<(), LaunchError> {
    let domain = domain_of(&args.domain)?;
    let launcher = domain.holder().ok_or_else(|| nothing_runs(&domain))?;
    let bus = Bus::join(&domain, "status")?;
    let (mut board, listener) = HealthBoard::open(&bus)?;
    let until = Instant::now() + PATIENCE;
    wait_on(&[listener], |wake| match board.take_in() {
        Err(cause) => ControlFlow::Break(Err(cause)),
        Ok(()) if wake == Wake::Stop => ControlFlow::Break(Ok(())),
        Ok(()) => match until.checked_duration_since(Instant::now()) {
            Some(left) if !left.is_zero() => ControlFlow::Continue(left),
            _ => ControlFlow::Break(Ok(())),
        },
    })??;
    let incidents = Incidents::read(&domain);
    if args.json {
        let stages: Map<String, Value> = board
            .all()
            .map(|(name, health)| (name.to_owned(), with_standbys(&board, name, health, &incidents)))
            .collect();
        println!(
            "{:#}",
            json!({
                "domain": domain.name(),
                "launcher_pid": launcher,
                "stages": stages,
                "incidents": incidents.newest,
            })
        );
    } else {
        print_table(&domain, launcher, &board, &incidents);
    }
    Ok(())
}

/// The instance that leads, and beside it those that do not.
fn with_standbys(board: &HealthBoard, name: &str, health: &Health, incidents: &Incidents) -> Value {
    let mut json = as_json(health);
    let others = board.instances(name).filter(|other| other.epoch != health.epoch);
    json["deaths"] = incidents.of_stage(name).count().into();
    json["standbys"] = others.map(as_json).collect();
    json
}

fn print_table(domain: &Domain, launcher: u32, board: &HealthBoard, incidents: &Incidents) {
    println!(
        "domain {}, launcher pid {launcher}; latencies in ms since the start: p50/p99/max",
        domain.name()
    );
    println!(
        "{:<16} {:>8} {:<9} {:>8} {:>8} {:>9} {:>5} {:>5} {:>8}  {:<22} {:<22} {:<22}",
        "stage",
        "pid",
        "state",
        "rate Hz",
        "age s",
        "frames",
        "lost",
        "late",
        "degraded",
        "ipc",
        "compute",
        "end to end"
    );
    let instances = board.all().flat_map(|(name, _)| board.instances(name).map(move |health| (name, health)));
    for (name, health) in instances {
        let name = if health.epoch == 0 { name.to_owned() } else { format!("{name} #{}", health.epoch) };
        let triple = |latency: &evac_frames::LatencySummary| {
            let ms = |ns: u64| ns as f64 * 1e-6;
            format!("{:.2}/{:.2}/{:.2}", ms(latency.p50_ns), ms(latency.p99_ns), ms(latency.max_ns))
        };
        println!(
            "{:<16} {:>8} {:<9} {:>8.1} {:>8} {:>9} {:>5} {:>5} {:>8}  {:<22} {:<22} {:<22}",
            name,
            health.pid,
            state_word(health),
            health.rate_millihertz as f64 * 1e-3,
            age_s(health).map_or("-".to_owned(), |age| format!("{age:.1}")),
            health.frames_out,
            health.lost,
            health.late,
            health.degraded,
            triple(&health.ipc),
            triple(&health.compute),
            triple(&health.end_to_end),
        );
        if let Some(line) = odometry_line(health) {
            println!("{:<16} {line}", "");
        }
        if let Some(line) = device_line(health) {
            println!("{:<16} {line}", "");
        }
        let reason = evac_frames::Health::text_of(&health.reason);
        if !reason.is_empty() {
            println!("{:<16} {reason}", "");
        }
        if let Some(incident) = incidents.of_stage(&Health::text_of(&health.name)).next_back()
            && health.epoch > incident.epoch
        {
            println!("{:<16} {}; {}", "", incident.cause, incident.outcome());
        }
    }
}

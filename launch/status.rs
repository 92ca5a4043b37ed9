//! `evac status`.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use evac_config::Pipeline;
use evac_frames::{Health, LatencySummary};
use evac_ports::{Domain, Wake, wait_on};
use evac_stage::RunError;

use crate::cli::{DomainArgs, StatusArgs};
use crate::device_health::device_line;
use crate::error::LaunchError;
use crate::health_board::{age_s, odometry_line, state_word};
use crate::view::{InstanceView, StageView, View, Watcher};

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
    let (mut watcher, listener) = Watcher::open(&domain_of(&args.domain)?, "status")?;
    // CPU is counted from here on.
    watcher.look()?;
    let until = Instant::now() + PATIENCE;
    wait_on(&[listener], |wake| match watcher.take_in() {
        Err(cause) => ControlFlow::Break(Err(cause)),
        Ok(()) if wake == Wake::Stop => ControlFlow::Break(Ok(())),
        Ok(()) => match until.checked_duration_since(Instant::now()) {
            Some(left) if !left.is_zero() => ControlFlow::Continue(left),
            _ => ControlFlow::Break(Ok(())),
        },
    })??;
    let view = watcher.look()?;
    if args.json {
        println!("{:#}", view.as_json());
    } else {
        print_table(&view);
    }
    Ok(())
}

fn print_table(view: &View) {
    println!(
        "domain {}, launcher pid {}; latencies in ms since the start: p50/p99/max; memory: own + shared MiB",
        view.domain, view.launcher
    );
    println!(
        "{:<16} {:>8} {:<9} {:>8} {:>8} {:>9} {:>5} {:>5} {:>8}  {:<22} {:<22} {:<22} {:>6} {:>9} {:>8} {:>8}",
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
        "end to end",
        "cpu %",
        "memory",
        "restarts",
        "leads"
    );
    for stage in &view.stages {
        for (index, instance) in stage.instances.iter().enumerate() {
            print_instance(stage, instance, index == 0);
        }
        if let Some(incident) = view.incidents.of_stage(&stage.name).next_back()
            && stage.instances.first().is_some_and(|leader| leader.health.epoch > incident.epoch)
        {
            println!("{:<16} {}; {}", "", incident.cause, incident.outcome());
        }
    }
}

fn print_instance(stage: &StageView, instance: &InstanceView, leads: bool) {
    let health = &instance.health;
    let restarts = stage.word.as_ref().map_or("-".to_owned(), |word| word.restarts.to_string());
    println!(
        "{:<16} {:>8} {:<9} {:>8.1} {:>8} {:>9} {:>5} {:>5} {:>8}  {:<22} {:<22} {:<22} {:>6} {:>9} {:>8} {:>8}",
        instance_name(&stage.name, health),
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
        instance.usage.map_or("-".to_owned(), |usage| format!("{:.1}", usage.cpu_percent)),
        memory(instance),
        if leads { restarts } else { "-".to_owned() },
        if leads { leads_from(stage) } else { "no".to_owned() },
    );
    if let Some(line) = odometry_line(health) {
        println!("{:<16} {line}", "");
    }
    if let Some(line) = device_line(health) {
        println!("{:<16} {line}", "");
    }
    let reason = Health::text_of(&health.reason);
    if !reason.is_empty() {
        println!("{:<16} {reason}", "");
    }
}

/// The stage's name, with the instance's number where it is not the first.
pub(crate) fn instance_name(name: &str, health: &Health) -> String {
    if health.epoch == 0 { name.to_owned() } else { format!("{name} #{}", health.epoch) }
}

/// From which frame on the leading instance leads.
pub(crate) fn leads_from(stage: &StageView) -> String {
    let from_seq = stage.word.as_ref().and_then(|word| word.from_seq);
    from_seq.map_or("start".to_owned(), |seq| seq.to_string())
}

/// Memory in MiB, own and shared.
pub(crate) fn memory(instance: &InstanceView) -> String {
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    instance
        .usage
        .map_or("-".to_owned(), |usage| format!("{:.0}+{:.0}", mib(usage.own_bytes), mib(usage.shared_bytes)))
}

/// Median, 99th percentile and maximum, milliseconds.
pub(crate) fn triple(latency: &LatencySummary) -> String {
    let ms = |ns: u64| ns as f64 * 1e-6;
    format!("{:.2}/{:.2}/{:.2}", ms(latency.p50_ns), ms(latency.p99_ns), ms(latency.max_ns))
}

//! `evac experiment restarts`: each stage is killed once without a standby while a simulated walk goes on in real time, and how long it
//! takes until the pipeline is whole again.

use std::collections::{BTreeMap, VecDeque};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::{Duration, Instant};

use evac_config::{Mode, Pipeline, StageEntry};
use evac_frames::Health;
use evac_ports::{Domain, now_ns};
use evac_stage::start_logging;
use indicatif::ProgressBar;
use rustix::process::Signal;
use toml::Value;

use super::cli::RestartsArgs;
use super::restarts_report::{Restart, Restarts};
use crate::chaos::monitor::Monitor;
use crate::check::check;
use crate::error::LaunchError;
use crate::finite::{create_folder, set, write_pipeline};
use crate::progress::bar;
use crate::registry::Role;
use crate::supervisor::{Progress, Supervisor, interrupted};

const PIPELINE: &str = include_str!("../pipelines/simulated.toml");
/// In turn.
pub(super) const STAGES: [&str; 7] =
    ["simulator", "deskewer", "lio", "octree_mapper", "grid_exporter", "map_saver", "recorder"];
/// The odometry has found its start, and everybody has seen a map.
const SETTLE: Duration = Duration::from_secs(6);
/// From one stage that is whole again to the next that is killed.
const PAUSE: Duration = Duration::from_secs(3);
/// A stage that crashes again within a minute is started again after a while only: each is killed once in this time.
const ROUND: Duration = Duration::from_secs(62);
/// A pipeline that is not whole again after this will not be.
const PATIENCE: Duration = Duration::from_secs(60);

pub(super) fn restarts(args: &RestartsArgs) -> Result<(), LaunchError> {
    start_logging(&args.log);
    create_folder(&args.output)?;
    let pipeline = pipeline(args)?;
    let file = args.output.join("pipeline.toml");
    write_pipeline(&file, &pipeline)?;
    let own = format!("restarts-{}", std::process::id());
    let domain = Domain::new(args.domain.as_deref().unwrap_or(&own))?;
    let (mut supervisor, wakeups) = Supervisor::start_lasting(&pipeline, &file, &domain, &args.log)?;
    let mut run = Run::new(args, &supervisor)?;
    let ended = wakeups.wait(|_| match run.step(&mut supervisor) {
        Ok(false) if supervisor.bus.stop_requested() => ControlFlow::Break(Err(interrupted())),
        Ok(false) => ControlFlow::Continue(Duration::from_millis(100)),
        Ok(true) => ControlFlow::Break(Ok(())),
        Err(error) => ControlFlow::Break(Err(error)),
    })?;
    run.bar.finish_and_clear();
    let stopped = supervisor.stop();
    ended.and(stopped)?;
    run.monitor.take_in()?;
    run.restarts.unstated = run.monitor.seen.unexplained(&supervisor.incidents.newest);
    println!("\n{}", run.restarts.table());
    println!("{}", run.restarts.write(&args.output)?.display());
    Ok(())
}

fn pipeline(args: &RestartsArgs) -> Result<Pipeline, LaunchError> {
    let mut pipeline = Pipeline::parse(Path::new("simulated.toml"), PIPELINE)?;
    pipeline.mode = Mode::Live;
    pipeline.stages.push(StageEntry::of_kind("recorder"));
    let seed = i64::try_from(args.seed)
        .map_err(|_| super::usage(format!("--seed {} is too large; use at most {}", args.seed, i64::MAX)))?;
    set(&mut pipeline, "simulator", "seed", Value::from(seed));
    // A lap takes longer than a round.
    set(&mut pipeline, "simulator", "laps", Value::from(i64::from(args.rounds) + 2));
    let folder = std::path::absolute(&args.output)
        .map_err(|cause| LaunchError::Path(format!("{}: {cause}", args.output.display())))?;
    for sink in ["grid_exporter", "map_saver"] {
        set(&mut pipeline, sink, "output_dir", Value::from(folder.display().to_string()));
    }
    set(
        &mut pipeline,
        "recorder",
        "output_dir",
        Value::from(folder.join("recordings").display().to_string()),
    );
    set(&mut pipeline, "recorder", "ros", Value::from(false));
    if let Some(unknown) = args.only.iter().find(|name| pipeline.stage(name).is_none()) {
        let names: Vec<_> = pipeline.stages.iter().map(StageEntry::name).collect();
        return Err(super::usage(format!("--only {unknown}: the pipeline has: {}", names.join(", "))));
    }
    check(&pipeline).map_err(super::usage)?;
    Ok(pipeline)
}

struct Run {
    monitor: Monitor,
    /// Newest frame that each sink is done with.
    done: BTreeMap<String, Option<u64>>,
    /// Stages that are still to be killed, with the round.
    kills: VecDeque<(u32, String)>,
    /// The round, and when it began.
    round: (u32, Instant),
    killed: Option<Killed>,
    /// Nothing is killed before.
    next: Instant,
    restarts: Restarts,
    bar: ProgressBar,
}

/// A stage whose pipeline is not whole again.
struct Killed {
    stage: String,
    epoch: u32,
    /// The first scan after its death: the pipeline is whole again when every sink is done with it.
    scan: u64,
    since: Instant,
    /// Host monotonic times: the new process has reported itself, and the pipeline is whole.
    up_ns: Option<i64>,
    whole_ns: Option<i64>,
}

impl Run {
    fn new(args: &RestartsArgs, supervisor: &Supervisor) -> Result<Self, LaunchError> {
        let sinks = supervisor.slots.iter().filter(|slot| slot.role == Role::Consumer);
        let of_round = |round: u32| args.only.iter().map(move |stage| (round, stage.clone()));
        let kills: VecDeque<_> = (0..args.rounds).flat_map(of_round).collect();
        let now = Instant::now();
        Ok(Self {
            monitor: Monitor::open(&supervisor.bus)?,
            done: sinks.map(|sink| (sink.name().to_owned(), None)).collect(),
            bar: bar(kills.len() as u64, "kills"),
            kills,
            round: (0, now),
            killed: None,
            next: now + SETTLE,
            restarts: Restarts::new(args.seed),
        })
    }

    /// Takes in what has come; whether all is through.
    fn step(&mut self, supervisor: &mut Supervisor) -> Result<bool, LaunchError> {
        if supervisor.watch()? == Progress::Finished {
            return Err(LaunchError::Silent("the walk ended before the kills; take fewer rounds".to_owned()));
        }
        self.monitor.take_in()?;
        while let Some(ack) = supervisor.take_ack()? {
            let done = self.done.entry(Health::text_of(&ack.name)).or_default();
            *done = (*done).max(Some(ack.seq));
        }
        if let Some(killed) = self.killed.take() {
            self.killed = self.follow(killed, supervisor)?;
            return Ok(false);
        }
        if Instant::now() < self.next {
            return Ok(false);
        }
        let Some((round, _)) = self.kills.front() else { return Ok(true) };
        if *round != self.round.0 {
            if self.round.1.elapsed() < ROUND {
                return Ok(false);
            }
            self.round = (*round, Instant::now());
        }
        if let Some((_, stage)) = self.kills.pop_front() {
            self.killed = Some(self.kill(stage, supervisor)?);
        }
        Ok(false)
    }

    fn kill(&self, stage: String, supervisor: &Supervisor) -> Result<Killed, LaunchError> {
        let slot = supervisor.slots.iter().find(|slot| slot.name() == stage);
        let child = slot.and_then(|slot| supervisor.child(slot.name(), slot.epoch));
        let child = child.ok_or_else(|| LaunchError::Silent(format!("stage '{stage}' does not run")))?;
        child.signal(Signal::KILL);
        let scan = self.monitor.seen.newest() + 1;
        let (epoch, since) = (child.epoch, Instant::now());
        Ok(Killed { stage, epoch, scan, since, up_ns: None, whole_ns: None })
    }

    /// The killed stage as it stands now; nothing when the pipeline is whole again and the launcher has said what it cost.
    fn follow(&mut self, mut killed: Killed, supervisor: &Supervisor) -> Result<Option<Killed>, LaunchError> {
        let newer = |health: &&Health| health.epoch > killed.epoch;
        let up_ns = supervisor.board.instances(&killed.stage).find(newer).map(|health| health.reported_ns);
        killed.up_ns = killed.up_ns.or(up_ns);
        let is_whole = self.done.values().all(|done| done.is_some_and(|seq| seq >= killed.scan));
        killed.whole_ns = killed.whole_ns.or(is_whole.then(now_ns));
        let incidents = supervisor.incidents.of_stage(&killed.stage);
        let incident = incidents.rev().find(|incident| incident.epoch == killed.epoch);
        let told = incident.and_then(|incident| Some((incident, incident.resumed.as_ref()?)));
        let (Some((incident, resumed)), Some(up_ns), Some(whole_ns)) = (told, killed.up_ns, killed.whole_ns)
        else {
            if killed.since.elapsed() > PATIENCE {
                return Err(LaunchError::Silent(format!(
                    "the pipeline was not whole {} s after stage '{}' was killed; run it with --log-level debug",
                    PATIENCE.as_secs(),
                    killed.stage
                )));
            }
            return Ok(Some(killed));
        };
        let after_ms = |ns: i64| (ns - incident.died_ns) as f64 * 1e-6;
        self.restarts.kills.push(Restart {
            stage: killed.stage.clone(),
            last_seq: incident.last_seq,
            next_seq: resumed.seq,
            up_ms: after_ms(up_ns),
            next_ms: resumed.after_ms,
            whole_ms: after_ms(whole_ns),
            repeated: resumed.repeated,
            missing: resumed.missing.clone(),
        });
        self.bar.inc(1);
        self.next = Instant::now() + PAUSE;
        Ok(None)
    }
}

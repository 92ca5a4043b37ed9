//! `evac experiment swaps`: stage after stage is swapped, or killed beside a standby, while a simulated walk goes on in real time.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use evac_config::{Mode, Pipeline};
use evac_formats::tum;
use evac_frames::StageState;
use evac_ports::Domain;
use evac_stage::start_logging;
use indicatif::ProgressBar;
use rustix::process::Signal;
use toml::Value;

use super::cli::SwapsArgs;
use super::swaps_monitor::Monitor;
use super::swaps_report::{Change, Swaps};
use crate::check::check;
use crate::control::{self, Order, Request};
use crate::error::LaunchError;
use crate::finite::{create_folder, set, write_pipeline};
use crate::progress::bar;
use crate::registry::ODOMETRIES;
use crate::supervisor::{Progress, Supervisor, interrupted};

const PIPELINE: &str = include_str!("../pipelines/simulated.toml");
/// In turn; the odometry becomes the other one each time.
pub(super) const TURNS: [&str; 5] = ["deskewer", "odometry", "octree_mapper", "grid_exporter", "map_saver"];
/// Longest time until a standby is ready, seconds.
const PATIENCE_S: f64 = 120.0;

/// What the thread that asks says to the one that supervises.
enum Word {
    Changed(Change),
    /// Kill the instance that leads; the standby of this epoch is to lead.
    Kill {
        stage: String,
        epoch: u32,
    },
    Failed(LaunchError),
    Done,
}

/// The standby of a stage that was killed.
struct Awaited {
    stage: String,
    epoch: u32,
    /// The newest pose's frame then.
    killed_at: u64,
    leads: bool,
}

pub(super) fn swaps(args: &SwapsArgs) -> Result<(), LaunchError> {
    start_logging(&args.log);
    create_folder(&args.output)?;
    let pipeline = pipeline(args)?;
    let file = args.output.join("pipeline.toml");
    write_pipeline(&file, &pipeline)?;
    let own = format!("swaps-{}", std::process::id());
    let domain = Domain::new(args.domain.as_deref().unwrap_or(&own))?;
    let mut swaps = walk(args, &pipeline, &file, &domain)?;
    // Every frame's pose is in the file, whichever savers gathered them.
    swaps.saved_poses = tum::read(&args.output.join("trajectory.tum"))?.len() as u64;
    println!("\n{}", swaps.table());
    println!("{}", swaps.write(&args.output)?.display());
    Ok(())
}

fn pipeline(args: &SwapsArgs) -> Result<Pipeline, LaunchError> {
    let mut pipeline = Pipeline::parse(Path::new("simulated.toml"), PIPELINE)?;
    pipeline.mode = Mode::Live;
    let seed = i64::try_from(args.seed)
        .map_err(|_| super::usage(format!("--seed {} is too large; use at most {}", args.seed, i64::MAX)))?;
    set(&mut pipeline, "simulator", "seed", Value::from(seed));
    // A lap takes longer than five swaps.
    set(&mut pipeline, "simulator", "laps", Value::from(i64::from(args.swaps) / 5 + 2));
    let folder = std::path::absolute(&args.output)
        .map_err(|cause| LaunchError::Path(format!("{}: {cause}", args.output.display())))?;
    for sink in ["grid_exporter", "map_saver"] {
        set(&mut pipeline, sink, "output_dir", Value::from(folder.display().to_string()));
    }
    check(&pipeline).map_err(super::usage)?;
    Ok(pipeline)
}

fn walk(args: &SwapsArgs, pipeline: &Pipeline, file: &Path, domain: &Domain) -> Result<Swaps, LaunchError> {
    let (mut supervisor, mut wakeups) = Supervisor::start(pipeline, file, domain, &args.log)?;
    let mut monitor = Monitor::open(&supervisor.bus)?;
    wakeups.listeners.append(&mut monitor.listeners);
    let bar = bar(u64::from(args.swaps), "swaps");
    let (words, heard) = channel();
    let (go_on, wait) = channel();
    let stages: Vec<_> = args.only.iter().cycle().take(args.swaps as usize).cloned().collect();
    let asker = Asker { domain: domain.clone(), words, wait, stages, kill: args.kill };
    let thread = std::thread::Builder::new().name("asker".to_owned()).spawn(move || asker.run());
    thread.map_err(|cause| LaunchError::Silent(format!("no thread can be started: {cause}")))?;
    let mut swaps = Swaps::new(args.seed, args.kill);
    let mut awaited = None;
    let ended = wakeups.wait(|_| {
        let step = step(&mut supervisor, &mut monitor, (&heard, &go_on), &mut awaited, &mut swaps, &bar);
        match step {
            Ok(false) if supervisor.bus.stop_requested() => ControlFlow::Break(Err(interrupted())),
            Ok(false) => ControlFlow::Continue(Duration::from_millis(100)),
            Ok(true) => ControlFlow::Break(Ok(())),
            Err(error) => ControlFlow::Break(Err(error)),
        }
    })?;
    bar.finish_and_clear();
    let stopped = supervisor.stop();
    monitor.take_in()?;
    while let Some(ack) = supervisor.take_ack()? {
        monitor.take_ack(&ack);
    }
    ended.and(stopped)?;
    monitor.finish(&mut swaps);
    swaps.stages_lost = supervisor.board().all().map(|(_, health)| health.lost + health.late).sum();
    Ok(swaps)
}

/// Takes in what has come; whether all swaps are through and every stage has put out frames since.
fn step(
    supervisor: &mut Supervisor,
    monitor: &mut Monitor,
    (heard, go_on): (&Receiver<Word>, &Sender<()>),
    awaited: &mut Option<Awaited>,
    swaps: &mut Swaps,
    bar: &ProgressBar,
) -> Result<bool, LaunchError> {
    if supervisor.watch()? == Progress::Finished {
        return Err(LaunchError::Silent("the walk ended before the swaps; swap fewer".to_owned()));
    }
    monitor.take_in()?;
    while let Some(ack) = supervisor.take_ack()? {
        monitor.take_ack(&ack);
    }
    if let Some(Awaited { stage, epoch, .. }) = awaited.as_ref().filter(|awaited| !awaited.leads) {
        let leads = supervisor
            .board()
            .of(stage, *epoch)
            .is_some_and(|health| health.state == StageState::Running as u32 && health.frames_out > 0);
        if let Some(awaited) = awaited.as_mut().filter(|_| leads) {
            awaited.leads = true;
            // The thread lives as long as it waits.
            let _ = go_on.send(());
        }
    }
    while let Ok(word) = heard.try_recv() {
        match word {
            Word::Changed(change) => {
                let seq = awaited.take().map_or(monitor.newest(), |awaited| awaited.killed_at);
                swaps.changes.push(Change { seq, ..change });
                bar.set_position(swaps.changes.len() as u64);
            }
            Word::Kill { stage, epoch } => {
                let led = supervisor.board().get(&stage).map_or(0, |health| health.epoch);
                if let Some(child) = supervisor.child(&stage, led) {
                    child.signal(Signal::KILL);
                }
                *awaited = Some(Awaited { stage, epoch, killed_at: monitor.newest(), leads: false });
            }
            Word::Failed(error) => return Err(error),
            Word::Done => return Ok(true),
        }
    }
    Ok(false)
}

/// Asks for one swap after the other, as a user would.
struct Asker {
    domain: Domain,
    words: Sender<Word>,
    wait: Receiver<()>,
    stages: Vec<String>,
    kill: bool,
}

impl Asker {
    fn run(self) {
        let word = match self.all() {
            Ok(()) => Word::Done,
            Err(error) => Word::Failed(error),
        };
        // Nobody listens any more where the run was stopped.
        let _ = self.words.send(word);
    }

    fn all(&self) -> Result<(), LaunchError> {
        // The odometry has found its start, and everybody has seen a map.
        std::thread::sleep(Duration::from_secs(5));
        let mut odometries = ODOMETRIES.iter().rev().cycle();
        for stage in &self.stages {
            let kind =
                if stage == "odometry" { odometries.next().map(|kind| (*kind).to_owned()) } else { None };
            let request = Request {
                order: if self.kill { Order::Standby } else { Order::Swap },
                stage: stage.clone(),
                kind,
                run: None,
                config: None,
                patience_s: PATIENCE_S,
            };
            let outcome = control::ask(&self.domain, &request, |_| ())?;
            if self.kill {
                let kill = Word::Kill { stage: outcome.stage.clone(), epoch: outcome.epoch };
                if self.words.send(kill).is_err() || self.wait.recv().is_err() {
                    return Ok(());
                }
            }
            let change = Change {
                stage: stage.clone(),
                kind: outcome.kind,
                ready_s: outcome.ready_s,
                handover_ms: outcome.handover_ms,
                seq: 0,
            };
            if self.words.send(Word::Changed(change)).is_err() {
                return Ok(());
            }
        }
        // What the last one does is seen too.
        std::thread::sleep(Duration::from_secs(1));
        Ok(())
    }
}

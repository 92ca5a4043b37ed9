//! `evac chaos`: faults at random while a simulated walk goes on in real time, and what must hold whatever happens.
//!
//! No frame is lost or doubled at the sinks beyond what the launcher states of a fault; the producer is never stalled by others; shared
//! memory, descriptors and memory are where they were; and the map on disk is the mapper's, bit by bit.

mod cli;
mod fault;
mod map;
mod monitor;
mod report;

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use evac_config::{Mode, Pipeline};
use evac_formats::write_atomically;
use evac_ports::Domain;
use evac_stage::start_logging;
use indicatif::ProgressBar;
use rustix::process::{Pid, Signal, kill_process_group};
use toml::Value;

pub(crate) use cli::ChaosArgs;
use fault::{Deed, Dice};
use monitor::{Monitor, Resources, STALL_MS};
use report::{Fault, Report};

use crate::check::check;
use crate::child::Child;
use crate::control::{self, Order, Outcome, Request};
use crate::error::LaunchError;
use crate::finite::{create_folder, set, write_pipeline};
use crate::incidents::Incident;
use crate::progress::bar;
use crate::registry::{ODOMETRIES, Role};
use crate::supervisor::{Progress, Supervisor, Wakeups, interrupted};

const PIPELINE: &str = include_str!("../pipelines/simulated.toml");
/// Before the first fault and after the last: every stage has settled, and every fault has shown what it does.
const SETTLE: Duration = Duration::from_secs(10);
/// What is held is compared with what was held after this time, or a quarter of a shorter run.
const BASELINE: Duration = Duration::from_secs(90);
/// A pipeline that is not whole again after this is broken.
const PATIENCE: Duration = Duration::from_secs(90);
/// Two of these are a stutter's period.
const STUTTER: Duration = Duration::from_millis(50);
const SLOW: Duration = Duration::from_secs(2);
/// Frames without output after which a stage hangs here: two seconds.
const HANG_FRAMES: u64 = 20;
/// Time between two lines where there is no terminal.
const LINE: Duration = Duration::from_secs(30);

/// `evac chaos`.
pub(crate) fn chaos(args: &ChaosArgs) -> Result<(), LaunchError> {
    start_logging(&args.log);
    create_folder(&args.output)?;
    let pipeline = pipeline(args)?;
    let file = args.output.join("pipeline.toml");
    write_pipeline(&file, &pipeline)?;
    let own = format!("chaos-{}", std::process::id());
    let domain = Domain::new(args.domain.as_deref().unwrap_or(&own))?;
    let (mut supervisor, wakeups) = Supervisor::start_lasting(&pipeline, &file, &domain, &args.log)?;
    let mut run = Run::new(args, &supervisor, &domain)?;
    run.go_on(&mut supervisor, &wakeups)?;
    let report = run.finish(supervisor, &args.output)?;
    println!("\n{}", report.table());
    let path = args.output.join("chaos.json");
    write_atomically(&path, |writer| {
        serde_json::to_writer_pretty(&mut *writer, &report).map_err(std::io::Error::from)?;
        std::io::Write::write_all(writer, b"\n")
    })?;
    println!("{}", path.display());
    match report.violations.len() {
        0 => Ok(()),
        count => {
            Err(LaunchError::Silent(format!("{count} things happened that must not; they are listed above")))
        }
    }
}

fn pipeline(args: &ChaosArgs) -> Result<Pipeline, LaunchError> {
    let usage = |cause: String| LaunchError::Run(evac_stage::RunError::Value(cause));
    if !(args.minutes > 0.0 && args.minutes <= 1440.0) {
        return Err(usage(format!("--minutes {} must be above 0 and at most 1440", args.minutes)));
    }
    let mut pipeline = Pipeline::parse(Path::new("simulated.toml"), PIPELINE)?;
    if !(args.rate > 0.0 && args.rate <= 10.0) {
        return Err(usage(format!("--rate {} must be above 0 and at most 10", args.rate)));
    }
    pipeline.mode = Mode::Live;
    pipeline.rate = Some(args.rate);
    pipeline.supervision.hang_after_frames = HANG_FRAMES;
    let seed = i64::try_from(args.seed)
        .map_err(|_| usage(format!("--seed {} is too large; use at most {}", args.seed, i64::MAX)))?;
    set(&mut pipeline, "simulator", "seed", Value::from(seed));
    // A lap takes more than a minute.
    set(&mut pipeline, "simulator", "laps", Value::from(args.minutes.ceil() as i64 + 3));
    let folder = std::path::absolute(&args.output)
        .map_err(|cause| LaunchError::Path(format!("{}: {cause}", args.output.display())))?;
    for sink in ["grid_exporter", "map_saver"] {
        set(&mut pipeline, sink, "output_dir", Value::from(folder.display().to_string()));
    }
    check(&pipeline).map_err(usage)?;
    Ok(pipeline)
}

/// A fault under way.
struct Active {
    fault: Fault,
    started: Instant,
    /// A stage that is stopped now, and when it goes on.
    stopped: Option<(u32, Instant)>,
    /// A stutter ends here.
    until: Instant,
    /// What the launcher answers to a request.
    answer: Option<Receiver<Result<Outcome, LaunchError>>>,
    /// Sinks have to get as far.
    wanted: u64,
}

struct Run<'a> {
    args: &'a ChaosArgs,
    domain: Domain,
    dice: Dice,
    monitor: Monitor,
    active: Option<Active>,
    next: Instant,
    started: Instant,
    end: Instant,
    before: Option<Resources>,
    after: Resources,
    samples: Vec<Resources>,
    faults: Vec<Fault>,
    incidents: Vec<Incident>,
    violations: Vec<String>,
    bar: ProgressBar,
    line: Instant,
}

impl<'a> Run<'a> {
    fn new(args: &'a ChaosArgs, supervisor: &Supervisor, domain: &Domain) -> Result<Self, LaunchError> {
        let now = Instant::now();
        let length = Duration::from_secs_f64(args.minutes * 60.0);
        Ok(Self {
            args,
            domain: domain.clone(),
            dice: Dice::new(args.seed),
            monitor: Monitor::open(&supervisor.bus)?,
            active: None,
            next: now + SETTLE,
            started: now,
            end: now + length,
            before: None,
            after: Resources::default(),
            samples: Vec::new(),
            faults: Vec::new(),
            incidents: Vec::new(),
            violations: Vec::new(),
            bar: bar(length.as_secs(), "seconds"),
            line: now,
        })
    }

    fn go_on(&mut self, supervisor: &mut Supervisor, wakeups: &Wakeups) -> Result<(), LaunchError> {
        wakeups.wait(|_| match self.step(supervisor) {
            Ok(_) if supervisor.bus.stop_requested() => ControlFlow::Break(Err(interrupted())),
            Ok(false) => ControlFlow::Continue(Duration::from_millis(20)),
            Ok(true) => ControlFlow::Break(Ok(())),
            Err(error) => ControlFlow::Break(Err(error)),
        })??;
        self.bar.finish_and_clear();
        Ok(())
    }

    /// Whether the time is over and nothing is under way.
    fn step(&mut self, supervisor: &mut Supervisor) -> Result<bool, LaunchError> {
        self.look(supervisor)?;
        let now = Instant::now();
        if let Some(active) = self.active.take() {
            self.active = self.carry_on(supervisor, active);
            return Ok(false);
        }
        if now < self.next {
            return Ok(false);
        }
        // Every reader has met the memory of a second writer by then: what is held swings between two bounds.
        let settled = BASELINE.min(self.end.duration_since(self.started) / 4);
        if self.before.is_none() && self.started.elapsed() >= settled {
            self.before = Some(Resources::of(supervisor, &self.domain));
        }
        if self.samples.len() as u64 <= self.started.elapsed().as_secs() / 60 {
            self.samples.push(Resources::of(supervisor, &self.domain));
        }
        if now >= self.end {
            // As long after the last fault as before the first.
            self.after = Resources::of(supervisor, &self.domain);
            return Ok(true);
        }
        let active = self.strike(supervisor);
        self.active = active;
        Ok(false)
    }

    fn look(&mut self, supervisor: &mut Supervisor) -> Result<(), LaunchError> {
        while supervisor.take_ack()?.is_some() {}
        if supervisor.watch()? == Progress::Finished {
            return Err(LaunchError::Silent("the walk ended before the time was over".to_owned()));
        }
        self.monitor.take_in()?;
        for incident in supervisor.incidents.newest.iter().filter(|incident| incident.resumed.is_some()) {
            let is_known = |known: &Incident| known.stage == incident.stage && known.epoch == incident.epoch;
            if !self.incidents.iter().any(is_known) {
                self.incidents.push(incident.clone());
            }
        }
        self.bar.set_position(self.started.elapsed().as_secs());
        if self.bar.is_hidden() && self.line.elapsed() > LINE {
            self.line = Instant::now();
            eprintln!(
                "chaos: {:.0} of {:.0} s, {} faults, {} frames at the sinks, {} incidents",
                self.started.elapsed().as_secs_f64(),
                self.args.minutes * 60.0,
                self.faults.len(),
                self.monitor.seen.acked(),
                self.incidents.len()
            );
        }
        Ok(())
    }

    /// Does something to a stage.
    fn strike(&mut self, supervisor: &Supervisor) -> Option<Active> {
        let (stage, deed) = self.dice.draw();
        let slot = supervisor.slots.iter().find(|slot| slot.name() == stage)?;
        let child = leader(supervisor, stage)?;
        let now = Instant::now();
        let newest = self.monitor.seen.newest();
        tracing::info!(stage, deed = deed.name(), frame = newest, "chaos");
        let mut active = Active {
            fault: Fault { stage: stage.to_owned(), deed, at_frame: newest, whole_s: None },
            started: now,
            stopped: None,
            until: now,
            answer: None,
            wanted: newest + 3,
        };
        match deed {
            Deed::Kill => child.signal(Signal::KILL),
            Deed::Freeze => child.signal(Signal::STOP),
            Deed::Pause | Deed::Slow => {
                child.signal(Signal::STOP);
                let pause = Duration::from_millis(300 + self.dice.below(1200));
                let first = if deed == Deed::Pause { pause } else { STUTTER };
                active.stopped = Some((child.pid(), now + first));
                active.until = if deed == Deed::Pause { now } else { now + SLOW };
            }
            Deed::Swap | Deed::KillBesideStandby => {
                let other = ODOMETRIES.iter().find(|kind| **kind != slot.entry.kind);
                let is_odometry = ODOMETRIES.contains(&slot.entry.kind.as_str());
                let request = Request {
                    order: if deed == Deed::Swap { Order::Swap } else { Order::Standby },
                    stage: stage.to_owned(),
                    kind: other
                        .filter(|_| self.args.loam && is_odometry && deed == Deed::Swap)
                        .map(|kind| (*kind).to_owned()),
                    run: None,
                    config: None,
                    patience_s: PATIENCE.as_secs_f64(),
                };
                let (domain, (say, hear)) = (self.domain.clone(), channel());
                std::thread::spawn(move || say.send(control::ask(&domain, &request, |_| ())));
                active.answer = Some(hear);
            }
        }
        Some(active)
    }

    /// The fault as it stands afterwards; nothing when the pipeline is whole again.
    fn carry_on(&mut self, supervisor: &Supervisor, mut active: Active) -> Option<Active> {
        let now = Instant::now();
        if let Some((pid, until)) = active.stopped
            && now >= until
        {
            signal(pid, Signal::CONT);
            active.stopped = None;
            if now < active.until {
                signal(pid, Signal::STOP);
                active.stopped = Some((pid, now + STUTTER));
            }
            active.wanted = self.monitor.seen.newest() + 3;
        }
        if let Some(answer) = &active.answer
            && let Ok(outcome) = answer.try_recv()
        {
            active.answer = None;
            active.wanted = self.monitor.seen.newest() + 3;
            match outcome {
                Ok(_) if active.fault.deed == Deed::KillBesideStandby => {
                    active.fault.at_frame = self.monitor.seen.newest();
                    active.started = now;
                    if let Some(child) = leader(supervisor, &active.fault.stage) {
                        child.signal(Signal::KILL);
                    }
                }
                Ok(_) => {}
                Err(cause) => self.violations.push(format!(
                    "{} of {} failed: {cause}",
                    active.fault.deed.name(),
                    active.fault.stage
                )),
            }
        }
        let busy = active.stopped.is_some() || active.answer.is_some();
        // A stage that is frozen lets the sinks go on for a while only where it is none of theirs: its death is the mark.
        let awaits_death = active.fault.deed == Deed::Freeze
            && !self.incidents.iter().any(|incident| {
                incident.stage == active.fault.stage
                    && incident.last_seq.is_some_and(|last| last + 40 >= active.fault.at_frame)
            });
        if !busy && !awaits_death && self.monitor.seen.acked() > active.wanted {
            active.fault.whole_s = Some(active.started.elapsed().as_secs_f64());
        } else if active.started.elapsed() < 2 * PATIENCE {
            return Some(active);
        } else {
            self.violations.push(format!(
                "{} of {} at frame {}: not whole again after {} s",
                active.fault.deed.name(),
                active.fault.stage,
                active.fault.at_frame,
                2 * PATIENCE.as_secs()
            ));
        }
        self.faults.push(active.fault);
        let pause = Duration::from_millis(1000 + self.dice.below(3000));
        self.next = now + if now + pause >= self.end { SETTLE } else { pause };
        None
    }

    /// Lets what is under way come to its end, compares the maps, and judges.
    fn finish(mut self, mut supervisor: Supervisor, folder: &Path) -> Result<Report, LaunchError> {
        supervisor.stop_role(Role::Producer)?;
        self.quiesce(&mut supervisor)?;
        let mapper = map::of_mapper(&supervisor.bus, || supervisor.bus.stop_requested())?;
        supervisor.stop()?;
        drop(supervisor);
        let saved = std::fs::read(folder.join("map.ot")).unwrap_or_default();
        let report = Report {
            seed: self.args.seed,
            minutes: self.started.elapsed().as_secs_f64() / 60.0,
            frames: self.monitor.seen.newest() + 1,
            longest_scan_gap_ms: self.monitor.seen.longest_gap_ms,
            sinks: self.monitor.seen.sinks.clone(),
            before: self.before.unwrap_or_default(),
            after: self.after,
            each_minute: std::mem::take(&mut self.samples),
            map_equal: !saved.is_empty() && saved == mapper,
            violations: self.judge(),
            faults: self.faults,
            incidents: self.incidents,
        };
        Ok(report)
    }

    /// Waits until every sink has all that was measured.
    fn quiesce(&mut self, supervisor: &mut Supervisor) -> Result<(), LaunchError> {
        let until = Instant::now() + PATIENCE;
        while self.monitor.seen.acked() <= self.monitor.seen.newest() && Instant::now() < until {
            self.look(supervisor)?;
            std::thread::sleep(Duration::from_millis(20));
        }
        if self.monitor.seen.acked() <= self.monitor.seen.newest() {
            self.violations.push(format!(
                "the sinks got to frame {} of {}",
                self.monitor.seen.acked(),
                self.monitor.seen.newest()
            ));
        }
        Ok(())
    }

    /// What must not be.
    fn judge(&mut self) -> Vec<String> {
        let mut found = std::mem::take(&mut self.violations);
        let seen = &self.monitor.seen;
        found.extend(seen.unexplained(&self.incidents));
        for (name, sink) in seen.sinks.iter().filter(|(_, sink)| sink.doubled > 0) {
            found.push(format!("{name} acknowledged {} frames twice", sink.doubled));
        }
        if seen.longest_gap_ms > STALL_MS {
            found.push(format!("the simulator said nothing for {:.0} ms", seen.longest_gap_ms));
        }
        if let Some(before) = self.before {
            found.extend(self.after.leaks(&before));
        }
        found
    }
}

/// The instance that leads.
fn leader<'a>(supervisor: &'a Supervisor, stage: &str) -> Option<&'a Child> {
    let slot = supervisor.slots.iter().find(|slot| slot.name() == stage)?;
    supervisor.child(stage, slot.epoch)
}

fn signal(pid: u32, signal: Signal) {
    let group = i32::try_from(pid).ok().and_then(Pid::from_raw);
    if let Some(group) = group {
        // One that has died meanwhile needs none.
        let _ = kill_process_group(group, signal);
    }
}

//! The run: faults one after the other, and what is held before and after them.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::{Duration, Instant};

use evac_ports::Domain;
use indicatif::ProgressBar;

use super::deed::{Active, PATIENCE, Stand};
use super::fault::{Deed, Dice, STAGES};
use super::monitor::{Monitor, STALL_MS};
use super::report::{Fault, Report};
use super::resources::Resources;
use super::{ChaosArgs, map};
use crate::error::LaunchError;
use crate::incidents::Incident;
use crate::progress::bar;
use crate::registry::Role;
use crate::supervisor::{Progress, Supervisor, Wakeups, interrupted};

/// Before the first fault and before what is held is measured: every stage has settled, and every fault has shown what it does.
const SETTLE: Duration = Duration::from_secs(10);
/// What is held is compared with what was held after this time, or a quarter of a shorter run: a lap and a half, so that most places are known.
const BASELINE: Duration = Duration::from_secs(120);
/// Time between two samples of what is held.
const SAMPLE: Duration = Duration::from_secs(60);
/// Time between two lines where there is no terminal.
const LINE: Duration = Duration::from_secs(30);

pub(super) struct Run<'a> {
    args: &'a ChaosArgs,
    domain: Domain,
    dice: Dice,
    monitor: Monitor,
    active: Option<Active>,
    next: Instant,
    started: Instant,
    length: Duration,
    /// Stages that are still to be swapped before what is held is measured; `None` while faults are drawn.
    muster: Option<VecDeque<&'static str>>,
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
    pub(super) fn new(
        args: &'a ChaosArgs,
        supervisor: &Supervisor,
        domain: &Domain,
    ) -> Result<Self, LaunchError> {
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
            length,
            muster: None,
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

    pub(super) fn go_on(
        &mut self,
        supervisor: &mut Supervisor,
        wakeups: &Wakeups,
    ) -> Result<(), LaunchError> {
        wakeups.wait(|_| match self.step(supervisor) {
            Ok(_) if supervisor.bus.stop_requested() => ControlFlow::Break(Err(interrupted())),
            Ok(false) => ControlFlow::Continue(Duration::from_millis(20)),
            Ok(true) => ControlFlow::Break(Ok(())),
            Err(error) => {
                self.violations.push(format!("the pipeline ended: {error}"));
                ControlFlow::Break(Ok(()))
            }
        })??;
        self.bar.finish_and_clear();
        Ok(())
    }

    /// Whether the time is over and nothing is under way.
    fn step(&mut self, supervisor: &mut Supervisor) -> Result<bool, LaunchError> {
        self.look(supervisor)?;
        if let Some(active) = self.active.take() {
            self.active = self.carry_on(supervisor, active);
            return Ok(false);
        }
        if Instant::now() < self.next {
            return Ok(false);
        }
        if self.samples.len() as u64 * SAMPLE.as_secs() <= self.started.elapsed().as_secs() {
            self.samples.push(self.held(supervisor));
        }
        let fault = match &mut self.muster {
            Some(muster) => match muster.pop_front() {
                Some(stage) => (stage, Deed::Swap),
                None => return Ok(self.measure(supervisor)),
            },
            None => {
                let due = if self.before.is_none() { BASELINE.min(self.length / 4) } else { self.length };
                if self.started.elapsed() >= due {
                    self.muster = Some(STAGES.into());
                    return Ok(false);
                }
                self.dice.draw()
            }
        };
        let newest = self.monitor.seen.newest();
        self.active = Active::strike(fault, supervisor, newest, &mut self.dice, self.args);
        Ok(false)
    }

    fn held(&self, supervisor: &Supervisor) -> Resources {
        let saved = std::fs::metadata(self.args.output.join("map.ot")).map_or(0, |file| file.len());
        Resources {
            at_s: self.started.elapsed().as_secs_f64(),
            saved_map_mib: saved as f64 / f64::from(1 << 20),
            ..Resources::of(supervisor, &self.domain)
        }
    }

    /// Takes note of what is held now that every process is new; whether it is the second time.
    fn measure(&mut self, supervisor: &Supervisor) -> bool {
        self.muster = None;
        let held = self.held(supervisor);
        let is_last = self.before.is_some();
        if is_last {
            self.after = held;
        } else {
            self.before = Some(held);
        }
        is_last
    }

    fn carry_on(&mut self, supervisor: &Supervisor, mut active: Active) -> Option<Active> {
        match active.step(supervisor, &self.monitor.seen, &self.incidents) {
            Stand::UnderWay => return Some(active),
            Stand::Whole => {}
            Stand::Broken(what) => self.violations.push(what),
        }
        self.faults.push(active.fault);
        let is_mustered = self.muster.as_ref().is_some_and(VecDeque::is_empty);
        let pause = Duration::from_millis(1000 + self.dice.below(3000));
        self.next = Instant::now() + if is_mustered { SETTLE } else { pause };
        None
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
                self.length.as_secs_f64(),
                self.faults.len(),
                self.monitor.seen.acked(),
                self.incidents.len()
            );
        }
        Ok(())
    }

    /// Lets what is under way come to its end, compares the maps, and judges.
    pub(super) fn finish(mut self, mut supervisor: Supervisor, folder: &Path) -> Report {
        let mapper = self.wind_up(&mut supervisor).unwrap_or_else(|cause| {
            self.violations.push(format!("the pipeline did not end as it should: {cause}"));
            Vec::new()
        });
        drop(supervisor);
        let saved = std::fs::read(folder.join("map.ot")).unwrap_or_default();
        let map_equal = !saved.is_empty() && saved == mapper;
        let violations = self.judge(map_equal);
        Report {
            seed: self.args.seed,
            minutes: self.started.elapsed().as_secs_f64() / 60.0,
            frames: self.monitor.seen.newest() + 1,
            longest_scan_gap_ms: self.monitor.seen.longest_gap_ms,
            sinks: self.monitor.seen.sinks,
            before: self.before.unwrap_or_default(),
            after: self.after,
            each_minute: self.samples,
            map_equal,
            violations,
            faults: self.faults,
            incidents: self.incidents,
        }
    }

    /// Ends the stages in the data's order; gives the mapper's map as it was at the end.
    fn wind_up(&mut self, supervisor: &mut Supervisor) -> Result<Vec<u8>, LaunchError> {
        supervisor.stop_role(Role::Producer)?;
        self.quiesce(supervisor)?;
        let mapper = map::of_mapper(&supervisor.bus, || supervisor.bus.stop_requested())?;
        supervisor.stop()?;
        Ok(mapper)
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
    fn judge(&mut self, map_equal: bool) -> Vec<String> {
        let mut found = std::mem::take(&mut self.violations);
        let seen = &self.monitor.seen;
        found.extend(seen.unexplained(&self.incidents));
        for (name, sink) in seen.sinks.iter().filter(|(_, sink)| sink.doubled > 0) {
            found.push(format!("{name} acknowledged {} frames twice", sink.doubled));
        }
        if seen.longest_gap_ms > STALL_MS {
            found.push(format!("the simulator said nothing for {:.0} ms", seen.longest_gap_ms));
        }
        if !map_equal {
            found.push("map.ot of the saver differs from the mapper's map".to_owned());
        }
        match &self.before {
            Some(before) => found.extend(self.after.leaks(before)),
            None => found.push("nothing was measured at the beginning".to_owned()),
        }
        found
    }
}

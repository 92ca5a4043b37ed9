//! Starts the stages of a pipeline as processes, watches them and stops them. No child outlives it.

use std::ops::ControlFlow;
use std::path::Path;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use evac_config::{Pipeline, StageEntry};
use evac_frames::{Ack, Health, Route, StageState};
use evac_ports::services::{Routes, SinkAck};
use evac_ports::{
    Bus, Domain, DomainLock, Doorbell, Listener, RecordPublisher, RecordSubscriber, Wake, wait_on_bells,
};
use evac_stage::LogOptions;
use rustix::process::Signal;

use crate::aftermath::{Aftermath, Roll};
use crate::child::{Child, Surroundings};
use crate::control::{Order, Server};
use crate::error::LaunchError;
use crate::health_board::HealthBoard;
use crate::incidents::{Incident, Incidents};
use crate::producer::Replacement;
use crate::pulse::{Pulse, line_of};
use crate::registry::Role;
use crate::restart::Restarts;
use crate::shadow::Shadows;
use crate::silence::Silence;
use crate::slot::Slot;
use crate::swap::Operation;
use crate::watch::{Seen, Watch, says_that_it_waits};

/// How long a stage may take until its ports are open.
const START_PATIENCE: Duration = Duration::from_secs(30);
/// How long a stage may take to end after SIGTERM; sinks write their files in this time.
const STOP_PATIENCE: Duration = Duration::from_secs(60);
const POLL: Duration = Duration::from_millis(20);

/// A running pipeline.
#[derive(Debug)]
pub(crate) struct Supervisor {
    pub(crate) pipeline: Pipeline,
    /// In the pipeline's order.
    pub(crate) slots: Vec<Slot>,
    /// Every process, standbys included.
    pub(crate) children: Vec<Child>,
    pub(crate) board: HealthBoard,
    pub(crate) around: Surroundings,
    pub(crate) operation: Option<Operation>,
    /// Producers between two instances.
    pub(crate) replacements: Vec<Replacement>,
    pub(crate) shadows: Shadows,
    /// Where crashed stages are started anew.
    pub(crate) restarts: Option<Restarts>,
    /// Stages that died, and what became of them.
    pub(crate) incidents: Incidents,
    pub(crate) pulse: Pulse,
    watch: Watch,
    silence: Silence,
    roll: Roll,
    control: Server,
    acks: RecordSubscriber<SinkAck>,
    routes: RecordPublisher<Routes>,
    pub(crate) bus: Bus,
    /// Dropped last: it removes what the domain left behind.
    _lock: DomainLock,
}

/// An instance that led.
struct Dead {
    epoch: u32,
    cause: LaunchError,
    died_ns: i64,
}

/// What a running pipeline is doing.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Progress {
    Running,
    /// Every sink has written everything.
    Finished,
}

/// What wakes whoever watches a pipeline: reports, acknowledgements, the end of a child, and requests.
#[derive(Debug)]
pub(crate) struct Wakeups {
    pub(crate) listeners: Vec<Listener>,
    bell: Doorbell,
}

impl Wakeups {
    /// As [`evac_ports::wait_on`].
    pub(crate) fn wait<B>(
        &self,
        look: impl FnMut(Wake) -> ControlFlow<B, Duration>,
    ) -> Result<B, LaunchError> {
        Ok(wait_on_bells(&self.listeners, &[&self.bell], look)?)
    }
}

impl Supervisor {
    /// Starts all stages: consumers and processors first, producers when all others are ready, so that no frame is missed.
    pub(crate) fn start(
        pipeline: &Pipeline,
        file: &Path,
        domain: &Domain,
        log: &LogOptions,
    ) -> Result<(Self, Wakeups), LaunchError> {
        Self::start_stages(pipeline, file, domain, log, false)
    }

    /// As [`Self::start`], where a stage that crashes is started again instead of ending the pipeline.
    pub(crate) fn start_lasting(
        pipeline: &Pipeline,
        file: &Path,
        domain: &Domain,
        log: &LogOptions,
    ) -> Result<(Self, Wakeups), LaunchError> {
        Self::start_stages(pipeline, file, domain, log, true)
    }

    fn start_stages(
        pipeline: &Pipeline,
        file: &Path,
        domain: &Domain,
        log: &LogOptions,
        lasting: bool,
    ) -> Result<(Self, Wakeups), LaunchError> {
        let mut aftermath = Aftermath::find(domain);
        let lock = domain.lock()?;
        aftermath.clean(domain);
        Shadows::clean_up(domain)?;
        let bus = Bus::join(domain, "launcher")?;
        bus.clean_up_dead();
        aftermath.say(domain);
        let (board, health_listener) = HealthBoard::open(&bus)?;
        let (acks, ack_listener) = RecordSubscriber::open(&bus)?;
        let bell = Doorbell::new()?;
        let mut supervisor = Self {
            pipeline: pipeline.clone(),
            slots: pipeline.stages.iter().map(Slot::new).collect::<Result<_, _>>()?,
            children: Vec::new(),
            board,
            around: Surroundings {
                domain: domain.clone(),
                log: *log,
                ringer: bell.ringer(),
                journals: lasting.then(|| journals(pipeline, domain)).flatten(),
                step: pipeline.step,
            },
            operation: None,
            replacements: Vec::new(),
            shadows: Shadows::default(),
            restarts: if lasting { Some(Restarts::open(&bus)?) } else { None },
            incidents: Incidents::of(domain),
            pulse: Pulse::open(&bus)?,
            watch: Watch::default(),
            silence: Silence::default(),
            roll: Roll::default(),
            control: Server::start(domain, bell.ringer())?,
            acks,
            routes: RecordPublisher::open(&bus)?,
            bus,
            _lock: lock,
        };
        for role in [Role::Consumer, Role::Processor, Role::Producer] {
            let entries: Vec<StageEntry> = supervisor
                .slots
                .iter()
                .filter(|slot| slot.role == role)
                .map(|slot| slot.entry.clone())
                .collect();
            for entry in &entries {
                let child = Child::spawn(entry, file, (0, false), &supervisor.around)?;
                supervisor.children.push(child);
            }
            // A producer may be through before anyone has looked.
            if role != Role::Producer {
                supervisor.wait_until_ready()?;
            }
        }
        Ok((supervisor, Wakeups { listeners: vec![ack_listener, health_listener], bell }))
    }

    fn wait_until_ready(&mut self) -> Result<(), LaunchError> {
        let until = Instant::now() + START_PATIENCE;
        loop {
            self.watch()?;
            let late = self.children.iter().find(|child| {
                let health = self.board.get(&child.name);
                health.is_none_or(|health| health.pid != child.pid())
            });
            let Some(late) = late else { return Ok(()) };
            if Instant::now() > until {
                return Err(LaunchError::Silent(format!(
                    "stage '{}' was not ready after {} s; run it by hand with --log-level debug",
                    late.name,
                    START_PATIENCE.as_secs()
                )));
            }
            if self.bus.stop_requested() {
                return Err(LaunchError::Silent("stopped before all stages were ready".to_owned()));
            }
            std::thread::sleep(POLL);
        }
    }

    /// Looks after the children, their reports, and what was asked for.
    pub(crate) fn watch(&mut self) -> Result<Progress, LaunchError> {
        self.board.take_in()?;
        for child in &mut self.children {
            child.look()?;
        }
        self.greet()?;
        self.feel_pulse()?;
        while let Some((request, mut reply)) = self.control.next() {
            if request.order == Order::Stages {
                reply.stages(self.stage_words());
                continue;
            }
            self.take_request(&request, reply);
        }
        self.operate()?;
        self.replace_dead()?;
        self.replace_producers()?;
        self.restart()?;
        // After all that somebody waits for.
        self.roll.keep(&self.around.domain, &self.children);
        // The stage that failed first is the cause; others may follow because of it.
        let mut leading =
            self.children.iter().filter(|child| self.leads(child) && !self.is_replacing(&child.name));
        if let Some(child) = leading.clone().find(|child| child.ended.is_some_and(|status| !status.success()))
        {
            return Err(child.failure());
        }
        // A producer may be through, a sink may have written everything; a processor ends only when it is told to.
        let is_of = |child: &&Child, role: Role| self.role_of(child) == Some(role);
        if let Some(child) = leading.find(|child| is_of(child, Role::Processor) && child.ended.is_some()) {
            return Err(LaunchError::Silent(format!(
                "stage '{}' ended although it was not told to",
                child.name
            )));
        }
        let mut sinks =
            self.children.iter().filter(|child| self.leads(child) && is_of(child, Role::Consumer)).peekable();
        let finished = sinks.peek().is_some() && sinks.all(|child| child.ended.is_some());
        let finished = finished && self.restarts.as_ref().is_none_or(|restarts| !restarts.are_under_way());
        Ok(if finished { Progress::Finished } else { Progress::Running })
    }

    /// Tells a process that has just come who leads.
    fn greet(&mut self) -> Result<(), LaunchError> {
        let mut is_new = false;
        for child in self.children.iter_mut().filter(|child| !child.greeted) {
            let health = self.board.of(&child.name, child.epoch);
            child.greeted = health.is_some_and(|health| health.pid == child.pid());
            is_new |= child.greeted;
        }
        if is_new {
            for route in self.slots.iter().filter_map(|slot| slot.route) {
                self.routes.publish(&route)?;
            }
        }
        Ok(())
    }

    /// Follows every stage frame by frame: one that hangs is killed, and one that was started again is seen to go on.
    fn feel_pulse(&mut self) -> Result<(), LaunchError> {
        self.pulse.take_in()?;
        for slot in &self.slots {
            let Some(line) = line_of(slot).filter(|_| self.incidents.open(slot.name())) else { continue };
            if let Some(resumption) = self.pulse.came(&line) {
                self.incidents.resumed(slot.name(), resumption);
            }
        }
        let after = self.pipeline.supervision.hang_after_frames;
        let (pulse, board) = (&self.pulse, &self.board);
        let seen = Seen {
            newest: &|line, epoch| pulse.newest(line, epoch),
            waits: &|slot| board.of(slot.name(), slot.epoch).is_some_and(says_that_it_waits),
        };
        let rule = (self.pipeline.mode, after);
        let mut hung = self.watch.hung(&self.slots, &seen, rule, Instant::now())?;
        if after > 0 {
            hung.extend(self.silence.hung(&self.slots, &self.board));
        }
        for (index, reason) in hung {
            let Some((name, epoch)) = self.slots.get(index).map(|slot| (slot.name().to_owned(), slot.epoch))
            else {
                continue;
            };
            self.watch.forget(index);
            // Who hands over stops by order, and is looked after there.
            if self.operation.as_ref().is_some_and(|operation| operation.cuts(&name)) {
                continue;
            }
            let child = self.children.iter_mut().find(|child| child.name == name && child.epoch == epoch);
            if let Some(child) = child.filter(|child| child.ended.is_none() && child.greeted) {
                child.hung = Some(reason);
                child.kill()?;
            }
        }
        Ok(())
    }

    /// Remembers that an instance that led has died.
    fn note_death(&mut self, index: usize, dead: &Dead, standby: bool) {
        let Some(slot) = self.slots.get(index) else { return };
        let (line, epoch) = (line_of(slot), dead.epoch);
        if let Some(resumption) = line.as_ref().and_then(|line| self.pulse.came_so_far(line)) {
            self.incidents.resumed(slot.name(), resumption);
        }
        // One that never got as far as the instance before it has put out nothing new.
        let before = self.incidents.of_stage(slot.name()).next_back().and_then(|incident| incident.last_seq);
        let last_seq = line.as_ref().and_then(|line| self.pulse.newest(line, epoch)).max(before);
        if let Some(line) = line {
            self.pulse.want(line.clone(), epoch, last_seq);
            self.pulse.forget(&line, epoch);
        }
        let incident = Incident::new(slot.name(), epoch, dead.cause.to_string(), standby, last_seq);
        self.incidents.add(Incident { died_ns: dead.died_ns, ..incident });
    }

    /// Where the leading instance of a stage has died, a standby that is ready takes its place, or else it is started anew.
    fn replace_dead(&mut self) -> Result<(), LaunchError> {
        let died = |child: &Child| child.ended.is_some_and(|status: ExitStatus| !status.success());
        for index in 0..self.slots.len() {
            let Some(slot) = self.slots.get(index) else { continue };
            let dead = self
                .children
                .iter()
                .find(|child| child.name == slot.name() && self.leads(child) && died(child))
                .filter(|child| !self.is_replacing(&child.name));
            let Some(dead) = dead else { continue };
            let name = dead.name.clone();
            let dead = Dead { epoch: dead.epoch, cause: dead.failure(), died_ns: dead.died_ns() };
            let cause = &dead.cause;
            // All that it has put out, before another one does.
            self.pulse.take_in()?;
            if let Some((epoch, pid)) = self.ready_standby(index) {
                // The word first: the standby waits for it, and nobody for what is written down.
                self.say(index, |slot| slot.take_over(epoch))?;
                self.note_death(index, &dead, true);
                tracing::warn!(stage = name, %cause, epoch, pid, "the standby has taken over");
                self.end(&name, dead.epoch)?;
                self.board.lead(&name, epoch);
            } else if self.plan_restart(index, (&name, dead.epoch))? {
                self.note_death(index, &dead, false);
                tracing::warn!(stage = name, %cause, "is started again");
                self.slots.iter_mut().skip(index).take(1).for_each(|slot| slot.restarts += 1);
                self.end(&name, dead.epoch)?;
            }
        }
        // A standby that died is missed by nobody.
        let gone: Vec<_> = self
            .children
            .iter()
            .filter(|child| child.ended.is_some() && !self.leads(child))
            .map(|child| (child.name.clone(), child.epoch, child.failure()))
            .collect();
        for (name, epoch, cause) in gone {
            let slot = self.slots.iter().position(|slot| slot.name() == name).unwrap_or(usize::MAX);
            let operated = self.operation.as_ref().is_some_and(|operation| operation.is_about(&name, epoch));
            let restarted = self.restarts.as_ref().is_some_and(|restarts| restarts.is_about(slot, epoch));
            if !operated && !restarted {
                tracing::warn!(stage = name, epoch, %cause, "a standby has ended");
                self.end(&name, epoch)?;
            }
        }
        Ok(())
    }

    fn slot_of_child(&self, child: &Child) -> Option<&Slot> {
        self.slots.iter().find(|slot| slot.name() == child.name)
    }

    fn leads(&self, child: &Child) -> bool {
        self.slot_of_child(child).is_some_and(|slot| slot.epoch == child.epoch)
    }

    fn role_of(&self, child: &Child) -> Option<Role> {
        self.slot_of_child(child).map(|slot| slot.role)
    }

    pub(crate) fn child(&self, name: &str, epoch: u32) -> Option<&Child> {
        self.children.iter().find(|child| child.name == name && child.epoch == epoch)
    }

    /// Ends an instance for good and frees what it left.
    pub(crate) fn end(&mut self, name: &str, epoch: u32) -> Result<(), LaunchError> {
        for child in self.children.iter_mut().filter(|child| child.name == name && child.epoch == epoch) {
            child.kill()?;
        }
        self.children.retain(|child| !(child.name == name && child.epoch == epoch));
        // What it has said last is heard before it is forgotten.
        self.board.take_in()?;
        self.board.forget(name, epoch);
        if epoch > 0 {
            // Its pipeline file; a shadow's may be gone with its folder.
            let _ = std::fs::remove_file(self.around.domain.folder().join(format!("{name}-{epoch}.toml")));
        }
        self.bus.clean_up_dead();
        Ok(())
    }

    /// Says a word about a stage to all processes.
    pub(crate) fn say(
        &mut self,
        slot: usize,
        word: impl FnOnce(&mut Slot) -> Result<Route, LaunchError>,
    ) -> Result<u64, LaunchError> {
        let Some(slot) = self.slots.get_mut(slot) else { return Ok(0) };
        let route = word(slot)?;
        self.routes.publish(&route)?;
        Ok(route.from_seq)
    }

    /// As [`Self::say`], where the instance that was started as `entry` leads from now on; gives its first frame.
    pub(crate) fn lead(
        &mut self,
        slot: usize,
        entry: &StageEntry,
        word: impl FnOnce(&mut Slot) -> Result<Route, LaunchError>,
    ) -> Result<u64, LaunchError> {
        let from_seq = self.say(slot, word)?;
        if let Some(slot) = self.slots.get_mut(slot) {
            slot.entry = entry.clone();
            self.board.lead(entry.name(), slot.epoch);
        }
        if let Some(place) = self.pipeline.stages.get_mut(slot) {
            *place = entry.clone();
        }
        Ok(from_seq)
    }

    /// Acknowledgements of the sinks since the last call.
    pub(crate) fn take_ack(&mut self) -> Result<Option<Ack>, LaunchError> {
        Ok(self.acks.receive()?)
    }

    /// Scans that the producer will send in all, where it knows.
    pub(crate) fn total_scans(&self) -> Option<u64> {
        let producers = self.children.iter().filter(|child| self.role_of(child) == Some(Role::Producer));
        producers
            .filter_map(|child| self.board.get(&child.name))
            .map(|health| health.total)
            .find(|total| *total > 0)
    }

    /// Newest report of every stage.
    pub(crate) fn board(&self) -> &HealthBoard {
        &self.board
    }

    /// Ends all stages in the order of the data's flow, so that what is under way is still written.
    pub(crate) fn stop(&mut self) -> Result<(), LaunchError> {
        let mut result = Ok(());
        for role in [Role::Producer, Role::Processor, Role::Consumer] {
            let ended = self.stop_role(role);
            result = result.and(ended);
        }
        // The last reports came while the stages ended.
        self.board.take_in()?;
        result
    }

    /// Ends all stages of a role.
    pub(crate) fn stop_role(&mut self, role: Role) -> Result<(), LaunchError> {
        let of_role: Vec<_> = (0..self.children.len())
            .filter(|index| self.children.get(*index).and_then(|child| self.role_of(child)) == Some(role))
            .collect();
        let of_role = |index: usize| of_role.contains(&index);
        let is_led: Vec<_> = self.children.iter().map(|child| self.leads(child)).collect();
        for (_, child) in self.children.iter().enumerate().filter(|(index, _)| of_role(*index)) {
            if child.ended.is_none() {
                child.signal(Signal::TERM);
            }
        }
        let until = Instant::now() + STOP_PATIENCE;
        let mut result = Ok(());
        for (index, child) in self.children.iter_mut().enumerate().filter(|(index, _)| of_role(*index)) {
            if child.ended.is_some() {
                continue;
            }
            while child.ended.is_none() {
                self.board.take_in()?;
                child.look()?;
                if child.ended.is_none() && Instant::now() > until {
                    tracing::warn!(stage = child.name, "did not end after SIGTERM and is killed");
                    child.kill()?;
                }
                std::thread::sleep(POLL);
            }
            // A standby's end is nobody's loss.
            let failed = child.ended.is_some_and(|status| !status.success());
            if failed && is_led.get(index) == Some(&true) {
                result = result.and(Err(child.failure()));
            }
        }
        result
    }
}

impl Drop for Supervisor {
    /// Whatever went wrong: no child outlives the launcher.
    fn drop(&mut self) {
        for child in self.children.iter_mut().filter(|child| child.ended.is_none()) {
            child.signal(Signal::TERM);
        }
        let until = Instant::now() + Duration::from_secs(5);
        for child in self.children.iter_mut().filter(|child| child.ended.is_none()) {
            while Instant::now() < until && child.look().is_ok() && child.ended.is_none() {
                std::thread::sleep(POLL);
            }
            // The child is gone either way; there is nobody left to tell.
            let _ = child.kill();
        }
        if let Some(folder) = &self.around.journals {
            // Whoever begins anew has no use for them. Where none was begun there is nothing to remove.
            let _ = std::fs::remove_dir_all(folder);
        }
        self.bus.clean_up_dead();
    }
}

/// Folder of a domain's journals, where the pipeline keeps any.
fn journals(pipeline: &Pipeline, domain: &Domain) -> Option<std::path::PathBuf> {
    let supervision = &pipeline.supervision;
    let folder = match &supervision.state_dir {
        Some(folder) => folder.join(domain.name()),
        None => domain.folder().join("journal"),
    };
    supervision.journal.then(|| std::path::absolute(&folder).unwrap_or(folder))
}

/// Names of the stages that report frames lost, with their numbers.
pub(crate) fn losses(board: &HealthBoard) -> Vec<String> {
    board
        .all()
        .filter(|(_, health)| health.lost + health.late > 0)
        .map(|(name, health)| format!("{name}: {} lost, {} late", health.lost, health.late))
        .collect()
}

/// The reason a stage gave for failing, if one did.
pub(crate) fn failure_reason(board: &HealthBoard) -> Option<String> {
    board
        .all()
        .find(|(_, health)| health.state == StageState::Failed as u32)
        .map(|(name, health)| format!("{name}: {}", Health::text_of(&health.reason)))
}

/// Stopping by a signal is not a failure of the pipeline, but the work is not done.
pub(crate) fn interrupted() -> LaunchError {
    LaunchError::Silent(
        "stopped by a signal before the walk had ended; the files hold what was mapped".to_owned(),
    )
}

//! Starts the stages of a pipeline as processes, watches them and stops them. No child outlives it.

mod deaths;
mod start;
mod stop;

use std::ops::ControlFlow;
use std::time::Duration;

use evac_config::{Pipeline, StageEntry};
use evac_frames::{Ack, Health, Route, StageState};
use evac_ports::services::{Routes, SinkAck};
use evac_ports::{
    Bus, DomainLock, Doorbell, Listener, RecordPublisher, RecordSubscriber, Wake, wait_on_bells,
};

use crate::aftermath::Roll;
use crate::child::{Child, Surroundings};
use crate::control::{Order, Server};
use crate::error::LaunchError;
use crate::health_board::HealthBoard;
use crate::incidents::Incidents;
use crate::producer::Replacement;
use crate::pulse::Pulse;
use crate::registry::Role;
use crate::restart::Restarts;
use crate::shadow::Shadows;
use crate::silence::Silence;
use crate::slot::Slot;
use crate::swap::Operation;
use crate::watch::Watch;

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

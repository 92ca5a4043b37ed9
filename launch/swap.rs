//! A swap or a standby under way: the new instance starts beside the old one, and only when it is ready anything changes.

mod beside;
mod request;

use std::time::{Duration, Instant};

use evac_config::StageEntry;
use evac_frames::{Health, Route, StageState};
use rustix::process::Signal;

use crate::child::Child;
use crate::control::{Order, Outcome, Reply};
use crate::error::LaunchError;
use crate::supervisor::Supervisor;

/// How long the old instance may take to finish the frame that it is at, before it is taken for hung and killed.
const HAND_OVER_PATIENCE: Duration = Duration::from_secs(10);
/// How long the old instance stays after the new one leads (ten frames of the twenty that it can hold): so that it goes on if the new
/// one dies of its first frames, and slow readers find everything in its place.
const LINGER: Duration = Duration::from_secs(1);
/// How long the new instance may take to lead after the word, while the old one still holds every frame since.
const TAKE_OVER_PATIENCE: Duration = Duration::from_secs(2);
/// How long it may take to end then.
const END_PATIENCE: Duration = Duration::from_secs(5);

/// A request that is being carried out.
#[derive(Debug)]
pub(crate) struct Operation {
    order: Order,
    reply: Reply,
    slot: usize,
    entry: StageEntry,
    /// The new instance.
    epoch: u32,
    pid: u32,
    started: Instant,
    ready_s: f64,
    /// How it was before the new one was routed, and when it was.
    before: Option<(StageEntry, Option<Route>, Instant)>,
    phase: Phase,
}

#[derive(Debug)]
enum Phase {
    /// The new one warms up.
    WarmUp { until: Instant },
    /// The old one has been asked to stop.
    HandOver { old: u32, since: Instant },
    /// The new one leads as soon as it has followed the old one to its end.
    TakeOver { old: Option<u32>, since: Instant, from_seq: u64 },
    /// The new one leads, and the old one is told to end.
    Linger { old: u32, since: Instant, told: bool, outcome: Outcome },
}

impl Supervisor {
    /// An instance that could take over.
    pub(crate) fn ready_standby(&self, slot: usize) -> Option<(u32, u32)> {
        let slot = self.slots.get(slot)?;
        let is_standby =
            |child: &&Child| child.name == slot.name() && child.epoch != slot.epoch && child.ended.is_none();
        let is_ready = |child: &&Child| self.state_of(child) == Some(StageState::Ready as u32);
        self.children.iter().filter(is_standby).find(is_ready).map(|child| (child.epoch, child.pid()))
    }

    fn state_of(&self, child: &Child) -> Option<u32> {
        let health = self.board.of(&child.name, child.epoch)?;
        (health.pid == child.pid()).then_some(health.state)
    }

    /// Carries the operation on as far as it goes now.
    pub(crate) fn operate(&mut self) -> Result<(), LaunchError> {
        while let Some(operation) = self.operation.take() {
            let phase = std::mem::discriminant(&operation.phase);
            self.operation = self.step(operation)?;
            let waits = |operation: &Operation| std::mem::discriminant(&operation.phase) == phase;
            if self.operation.as_ref().is_some_and(waits) {
                break;
            }
        }
        Ok(())
    }

    /// What is left of the operation after its next step.
    fn step(&mut self, mut operation: Operation) -> Result<Option<Operation>, LaunchError> {
        let (slot, epoch) = (operation.slot, operation.epoch);
        let Some(old) = self.slots.get(slot).map(|slot| slot.epoch) else { return Ok(None) };
        let name = operation.entry.name().to_owned();
        let state = self.child(&name, epoch).and_then(|child| self.state_of(child));
        let gone = self.child(&name, epoch).is_none_or(|child| child.ended.is_some());
        if let Phase::Linger { old, told: false, .. } = operation.phase
            && gone
            && self.child(&name, old).is_some_and(|child| child.ended.is_none())
        {
            return self.go_back(operation, old);
        }
        match operation.phase {
            Phase::WarmUp { until } => {
                if gone {
                    let why = self.why(&name, epoch);
                    return self
                        .give_up(operation, &format!("the new instance ended before it was ready: {why}"));
                }
                if old == epoch {
                    // The routed instance has died meanwhile, and this one leads already.
                    operation.phase = Phase::TakeOver { old: None, since: Instant::now(), from_seq: 0 };
                    return Ok(Some(operation));
                }
                let is_shadow = operation.order == Order::Shadow;
                let awaited = if is_shadow { StageState::Shadow } else { StageState::Ready };
                if state != Some(awaited as u32) {
                    if Instant::now() < until {
                        return Ok(Some(operation));
                    }
                    let word = match state {
                        Some(state) if state == StageState::Following as u32 => "it follows but is not ready",
                        _ => "it has said nothing",
                    };
                    let waited = operation.started.elapsed().as_secs_f64();
                    return self.give_up(
                        operation,
                        &format!("after {waited:.0} s {word}; give it longer with --patience"),
                    );
                }
                operation.ready_s = operation.started.elapsed().as_secs_f64();
                if is_shadow || operation.order == Order::Standby {
                    operation.reply.done(&operation.outcome(None, None));
                    return Ok(None);
                }
                operation.reply.progress(&format!("ready after {:.1} s", operation.ready_s));
                self.say(slot, |slot| slot.ask_to_hand_over())?;
                operation.phase = Phase::HandOver { old, since: Instant::now() };
            }
            Phase::HandOver { old, since } => {
                if gone {
                    let why = self.why(&name, epoch);
                    self.say(slot, |slot| slot.go_on())?;
                    return self
                        .give_up(operation, &format!("the new instance ended while it took over: {why}"));
                }
                let retired = self
                    .board
                    .of(&name, old)
                    .filter(|health| health.state == StageState::Retired as u32)
                    .map(|health| health.last_seq);
                let old_gone = self.child(&name, old).is_none_or(|child| child.ended.is_some());
                if let Some(last_seq) = retired {
                    operation.before =
                        self.slots.get(slot).map(|slot| (slot.entry.clone(), slot.route, Instant::now()));
                    let route = self.lead(slot, &operation.entry, |slot| slot.hand_over(epoch, last_seq))?;
                    operation.phase = Phase::TakeOver { old: Some(old), since, from_seq: route };
                } else if old_gone || since.elapsed() > HAND_OVER_PATIENCE {
                    operation.reply.progress("the old instance does not answer; it is killed");
                    self.end(&name, old)?;
                    self.lead(slot, &operation.entry, |slot| slot.take_over(epoch))?;
                    operation.phase = Phase::TakeOver { old: None, since, from_seq: 0 };
                } else {
                    return Ok(Some(operation));
                }
            }
            Phase::TakeOver { old, since, from_seq } => {
                // One that followed does not wait any more, unless it leads and has to ask for the map.
                let leading = [StageState::Running, StageState::Waiting, StageState::Finished];
                let leads = state.is_some_and(|state| leading.iter().any(|lead| *lead as u32 == state));
                let routed = operation.before.as_ref().map_or(since, |(_, _, routed)| *routed);
                let is_late = !leads && routed.elapsed() > TAKE_OVER_PATIENCE;
                if let Some(old) = old.filter(|_| gone || is_late) {
                    return self.go_back(operation, old);
                }
                if gone || !leads {
                    // Its death is that of the instance that leads, and handled as such.
                    return Ok(if gone { None } else { Some(operation) });
                }
                let ms = since.elapsed().as_secs_f64() * 1e3;
                let outcome = operation.outcome(Some(from_seq), Some(ms));
                let Some(old) = old else {
                    self.finish(slot, operation.order, &mut operation.reply, &outcome)?;
                    return Ok(None);
                };
                operation.reply.progress(&format!("instance {epoch} leads from frame {from_seq} on"));
                operation.phase = Phase::Linger { old, since: Instant::now(), told: false, outcome };
            }
            Phase::Linger { old, since, told, outcome } => {
                let ended = self.child(&name, old).is_none_or(|child| child.ended.is_some());
                if ended || since.elapsed() > LINGER + END_PATIENCE {
                    self.end(&name, old)?;
                    self.say(slot, |slot| slot.alone())?;
                    self.finish(slot, operation.order, &mut operation.reply, &outcome)?;
                    return Ok(None);
                }
                let due = since.elapsed() > LINGER;
                if due
                    && !told
                    && let Some(child) = self.child(&name, old)
                {
                    child.signal(Signal::TERM);
                }
                operation.phase = Phase::Linger { old, since, told: told || due, outcome };
            }
        }
        Ok(Some(operation))
    }

    /// The new instance leads.
    fn finish(
        &mut self,
        slot: usize,
        order: Order,
        reply: &mut Reply,
        outcome: &Outcome,
    ) -> Result<(), LaunchError> {
        if order == Order::Promote {
            self.end_shadow(slot)?;
        }
        reply.done(outcome);
        Ok(())
    }

    /// The new instance has died of its first frames or does not lead at all, and the old one, which still holds its inputs, leads again.
    fn go_back(&mut self, mut operation: Operation, old: u32) -> Result<Option<Operation>, LaunchError> {
        let (slot, epoch) = (operation.slot, operation.epoch);
        let gone = self.child(operation.entry.name(), epoch).is_none_or(|child| child.ended.is_some());
        let cause = if gone {
            let why = self.why(operation.entry.name(), epoch);
            format!("the new instance ended soon after it was to take over: {why}")
        } else {
            format!("the new instance did not take over within {} s", TAKE_OVER_PATIENCE.as_secs())
        };
        let (entry, route) = match operation.before.take() {
            Some((entry, route, _)) => (entry, route),
            None => (operation.entry.clone(), None),
        };
        self.lead(slot, &entry, |slot| slot.go_back(old, route))?;
        self.give_up(operation, &cause)
    }

    /// The new instance is killed, and the old one is what it was.
    fn give_up(&mut self, mut operation: Operation, cause: &str) -> Result<Option<Operation>, LaunchError> {
        self.end(operation.entry.name(), operation.epoch)?;
        tracing::warn!(stage = operation.entry.name(), cause, "nothing is swapped");
        operation.reply.fail(&format!("{}: {cause}; the old instance goes on", operation.entry.name()));
        Ok(None)
    }

    /// Why an instance ended: in its own words, if it had any.
    fn why(&self, name: &str, epoch: u32) -> String {
        let own =
            self.board.of(name, epoch).map(|health| Health::text_of(&health.reason)).unwrap_or_default();
        let failure = self.child(name, epoch).map_or_else(String::new, |child| child.failure().to_string());
        if own.is_empty() { failure } else { own }
    }
}

impl Operation {
    /// Whether the instance is one that the operation looks after.
    pub(crate) fn is_about(&self, name: &str, epoch: u32) -> bool {
        let old = match &self.phase {
            Phase::WarmUp { .. } => None,
            Phase::HandOver { old, .. } | Phase::Linger { old, .. } => Some(*old),
            Phase::TakeOver { old, .. } => *old,
        };
        self.entry.name() == name && (self.epoch == epoch || old == Some(epoch))
    }

    /// Whether a stage of that name is between two instances.
    pub(crate) fn cuts(&self, name: &str) -> bool {
        self.entry.name() == name && matches!(self.phase, Phase::HandOver { .. } | Phase::TakeOver { .. })
    }

    fn outcome(&self, from_seq: Option<u64>, handover_ms: Option<f64>) -> Outcome {
        Outcome {
            stage: self.entry.name().to_owned(),
            kind: self.entry.kind.clone(),
            pid: self.pid,
            epoch: self.epoch,
            from_seq,
            ready_s: self.ready_s,
            handover_ms,
        }
    }
}

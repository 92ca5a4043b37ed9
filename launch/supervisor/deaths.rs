//! Stages that hang or have died: what is done about it, and what is said.

use std::process::ExitStatus;
use std::time::Instant;

use super::Supervisor;
use crate::child::Child;
use crate::error::LaunchError;
use crate::incidents::Incident;
use crate::pulse::line_of;
use crate::watch::{Seen, says_that_it_waits};

/// An instance that led.
struct Dead {
    epoch: u32,
    cause: LaunchError,
    died_ns: i64,
}

impl Supervisor {
    /// Follows every stage frame by frame: one that hangs is killed, and one that was started again is seen to go on.
    pub(super) fn feel_pulse(&mut self) -> Result<(), LaunchError> {
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
    pub(super) fn replace_dead(&mut self) -> Result<(), LaunchError> {
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
}

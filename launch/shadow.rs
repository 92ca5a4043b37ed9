//! Shadows: instances of a processor on the same input as the one that leads, whose output nobody in the pipeline hears. They write into a
//! domain of their own, so that no reader, gate or route can meet their frames.

use std::path::PathBuf;

use evac_config::StageEntry;
use evac_ports::{Domain, DomainLock};

use crate::child::executable;
use crate::control::{Outcome, Reply, Request};
use crate::error::LaunchError;
use crate::registry::Role;
use crate::supervisor::Supervisor;

/// The shadows of a pipeline, one a stage at most.
#[derive(Debug, Default)]
pub(crate) struct Shadows {
    started: Vec<Shadow>,
    /// Of the domain that they write into; removes it at the end.
    lock: Option<DomainLock>,
}

#[derive(Debug, Clone)]
pub(crate) struct Shadow {
    slot: usize,
    epoch: u32,
    pub(crate) entry: StageEntry,
}

impl Shadows {
    /// Removes what the shadows of a killed launcher left.
    pub(crate) fn clean_up(domain: &Domain) -> Result<(), LaunchError> {
        // A name that is too long has none.
        if let Ok(shadows) = domain.of_shadows()
            && shadows.folder().exists()
        {
            drop(shadows.lock()?);
        }
        Ok(())
    }
}

impl Supervisor {
    /// Starts a shadow; gives its epoch and pid.
    pub(crate) fn start_shadow(
        &mut self,
        slot: usize,
        entry: &StageEntry,
    ) -> Result<(u32, u32), LaunchError> {
        let name = entry.name().to_owned();
        if self.slots.get(slot).is_none_or(|slot| slot.role != Role::Processor) {
            return Err(LaunchError::Path(format!(
                "'{name}' writes files, and a second one would write over them; only processors can have shadows"
            )));
        }
        if let Ok(shadow) = self.shadow_of(slot) {
            return Err(LaunchError::Path(format!(
                "instance {} is the shadow of '{name}' already; end it with evac shadow --stop {name}",
                shadow.epoch
            )));
        }
        if self.shadows.lock.is_none() {
            self.shadows.lock = Some(self.around.domain.of_shadows()?.lock()?);
        }
        let (executable, mut arguments) = executable(entry)?;
        arguments.push(PathBuf::from("--shadow"));
        let run = [vec![executable], arguments].concat();
        let started = StageEntry { run: Some(run), ..entry.clone() };
        let (epoch, pid) = self.start_beside(slot, entry, &started, false)?;
        self.shadows.started.retain(|shadow| shadow.slot != slot);
        self.shadows.started.push(Shadow { slot, epoch, entry: entry.clone() });
        Ok((epoch, pid))
    }

    /// The stage's shadow, if it lives.
    pub(crate) fn shadow_of(&self, slot: usize) -> Result<&Shadow, LaunchError> {
        let lives = |shadow: &&Shadow| {
            let child = self.child(shadow.entry.name(), shadow.epoch);
            shadow.slot == slot && child.is_some_and(|child| child.ended.is_none())
        };
        self.shadows.started.iter().find(lives).ok_or_else(|| {
            let name = self.slots.get(slot).map_or("", |slot| slot.name());
            LaunchError::Path(format!(
                "'{name}' has no shadow; start one with evac shadow {name} --run EXECUTABLE"
            ))
        })
    }

    /// Ends the stage's shadow, if it has one.
    pub(crate) fn end_shadow(&mut self, slot: usize) -> Result<(), LaunchError> {
        let Ok(Shadow { epoch, entry, .. }) = self.shadow_of(slot).cloned() else { return Ok(()) };
        self.shadows.started.retain(|shadow| shadow.slot != slot);
        self.end(entry.name(), epoch)
    }

    /// `evac shadow --stop`.
    pub(crate) fn end_shadow_by_request(&mut self, request: &Request, mut reply: Reply) {
        let ended = self.slot_of(&request.stage).and_then(|slot| {
            let Shadow { epoch, entry, .. } = self.shadow_of(slot)?.clone();
            let pid = self.child(entry.name(), epoch).map_or(0, |child| child.pid());
            self.end_shadow(slot)?;
            Ok(Outcome {
                stage: entry.name().to_owned(),
                kind: entry.kind.clone(),
                pid,
                epoch,
                from_seq: None,
                ready_s: 0.0,
                handover_ms: None,
            })
        });
        match ended {
            Ok(outcome) => reply.done(&outcome),
            Err(cause) => reply.fail(&cause.to_string()),
        }
    }
}

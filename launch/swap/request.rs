//! What is asked for: which stage, and by what it is to be replaced.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use evac_config::{Pipeline, StageEntry};
use evac_recorder::Recorder;
use evac_stage::Stage as _;

use super::{Operation, Phase};
use crate::control::{Order, Reply, Request};
use crate::error::LaunchError;
use crate::registry::{ODOMETRIES, kind};
use crate::supervisor::Supervisor;

impl Supervisor {
    /// Takes up a request, or says why not.
    pub(crate) fn take_request(&mut self, request: &Request, mut reply: Reply) {
        if let Some(slot) = self.producer(&request.stage) {
            return self.take_producer_request(slot, request, reply);
        }
        if request.order == Order::Unshadow {
            return self.end_shadow_by_request(request, reply);
        }
        if self.operation.is_some() {
            return reply.fail("another request is under way; ask again when it is through");
        }
        match self.begin(request) {
            Ok((slot, entry, epoch, pid)) => {
                reply.progress(&format!(
                    "instance {epoch} of '{}' ({}) starts, pid {pid}",
                    request.stage, entry.kind
                ));
                let now = Instant::now();
                let patience = Duration::try_from_secs_f64(request.patience_s).unwrap_or(Duration::MAX);
                let until = now.checked_add(patience).unwrap_or(now + Duration::from_secs(86_400));
                self.operation = Some(Operation {
                    order: request.order,
                    reply,
                    slot,
                    entry,
                    epoch,
                    pid,
                    started: now,
                    ready_s: 0.0,
                    before: None,
                    phase: Phase::WarmUp { until },
                });
            }
            Err(cause) => reply.fail(&cause.to_string()),
        }
    }

    fn begin(&mut self, request: &Request) -> Result<(usize, StageEntry, u32, u32), LaunchError> {
        let slot = self.slot_of(&request.stage)?;
        let entry = match request.order {
            Order::Promote => self.shadow_of(slot)?.entry.clone(),
            _ => self.entry_for(slot, request)?,
        };
        if request.order == Order::Shadow {
            let (epoch, pid) = self.start_shadow(slot, &entry)?;
            return Ok((slot, entry, epoch, pid));
        }
        let is_as_before = request.run.is_none() && request.kind.is_none() && request.config.is_none();
        if request.order == Order::Swap
            && is_as_before
            && let Some((epoch, pid)) = self.ready_standby(slot)
        {
            return Ok((slot, entry, epoch, pid));
        }
        let (epoch, pid) = self.start_standby(slot, &entry)?;
        Ok((slot, entry, epoch, pid))
    }

    /// The stage by its name; `odometry` is whichever there is.
    pub(crate) fn slot_of(&self, name: &str) -> Result<usize, LaunchError> {
        let by_name = self.slots.iter().position(|slot| slot.name() == name);
        let is_odometry = |kind: &str| name == "odometry" && ODOMETRIES.contains(&kind);
        let found = by_name.or_else(|| self.slots.iter().position(|slot| is_odometry(&slot.entry.kind)));
        let Some((index, slot)) = found.and_then(|index| Some((index, self.slots.get(index)?))) else {
            let names: Vec<_> = self.slots.iter().map(|slot| slot.name()).collect();
            return Err(LaunchError::Path(format!(
                "there is no stage '{name}'; the pipeline has: {}",
                names.join(", ")
            )));
        };
        if slot.entry.kind == Recorder::NAME {
            return Err(LaunchError::Path(format!(
                "'{name}' records, and a second one beside it would write over its files; run another recorder into another folder"
            )));
        }
        Ok(index)
    }

    /// The new instance's entry of the pipeline.
    pub(crate) fn entry_for(&self, slot: usize, request: &Request) -> Result<StageEntry, LaunchError> {
        let Some(old) = self.slots.get(slot).map(|slot| &slot.entry) else {
            return Err(LaunchError::Path("no such stage".to_owned()));
        };
        let mut entry = StageEntry { name: Some(old.name().to_owned()), ..old.clone() };
        if let Some(new) = &request.kind {
            if kind(new)?.writes != kind(&old.kind)?.writes {
                return Err(LaunchError::Path(format!(
                    "a stage of kind '{new}' does not write what '{}' does ({}); choose one that does",
                    old.name(),
                    kind(&old.kind)?.writes.join(", ")
                )));
            }
            if *new != old.kind {
                new.clone_into(&mut entry.kind);
                entry.config.clear();
                entry.run = None;
            }
        }
        if request.run.is_some() {
            entry.run.clone_from(&request.run);
        }
        if let Some(file) = &request.config {
            entry.config = config_from(file, &entry)?;
        }
        Ok(entry)
    }
}

/// The configuration of the stage of that name or kind in a pipeline file.
fn config_from(file: &PathBuf, entry: &StageEntry) -> Result<toml::Table, LaunchError> {
    let pipeline = Pipeline::read(Path::new(file))?;
    let by_name = pipeline.stage(entry.name()).filter(|found| found.kind == entry.kind);
    let found = by_name.or_else(|| pipeline.stages.iter().find(|found| found.kind == entry.kind));
    found.map(|found| found.config.clone()).ok_or_else(|| {
        LaunchError::Path(format!(
            "{}: there is no [[stage]] of kind '{}' in it; add one with its [stage.config]",
            file.display(),
            entry.kind
        ))
    })
}

//! Instances that are started beside the one that leads.

use std::path::PathBuf;

use evac_config::StageEntry;
use evac_formats::write_for_this_boot;

use crate::child::Child;
use crate::error::LaunchError;
use crate::finite::pipeline_text;
use crate::supervisor::Supervisor;

impl Supervisor {
    /// Starts an instance that follows; gives its epoch and pid.
    pub(crate) fn start_standby(
        &mut self,
        slot: usize,
        entry: &StageEntry,
    ) -> Result<(u32, u32), LaunchError> {
        self.start_beside(slot, entry, entry, true)
    }

    /// Starts an instance of `entry` beside the one that leads, by the command line of `started`.
    pub(crate) fn start_beside(
        &mut self,
        slot: usize,
        entry: &StageEntry,
        started: &StageEntry,
        standby: bool,
    ) -> Result<(u32, u32), LaunchError> {
        let mut pipeline = self.pipeline.clone();
        if let Some(place) = pipeline.stages.get_mut(slot) {
            *place = entry.clone();
        }
        crate::check::check(&pipeline).map_err(LaunchError::Path)?;
        let epoch = self.slots.get_mut(slot).map_or(0, |slot| slot.take_epoch());
        let file = self.write_pipeline(slot, entry, epoch)?;
        let child = Child::spawn(started, &file, (epoch, standby), &self.around)?;
        let pid = child.pid();
        self.children.push(child);
        Ok((epoch, pid))
    }

    /// The pipeline file of an instance, in the domain's folder.
    pub(crate) fn write_pipeline(
        &self,
        slot: usize,
        entry: &StageEntry,
        epoch: u32,
    ) -> Result<PathBuf, LaunchError> {
        let mut pipeline = self.pipeline.clone();
        if let Some(place) = pipeline.stages.get_mut(slot) {
            *place = entry.clone();
        }
        let file = self.around.domain.folder().join(format!("{}-{epoch}.toml", entry.name()));
        let text = pipeline_text(&pipeline)?;
        write_for_this_boot(&file, |writer| std::io::Write::write_all(writer, text.as_bytes()))?;
        Ok(file)
    }
}

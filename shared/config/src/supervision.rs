//! How the launcher looks after the stages, and how the kernel schedules each.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// `[supervision]`: what counts as a hang, and where stages keep what a crash must not lose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Supervision {
    /// A stage whose inputs have gone on by so many frames while it put out nothing hangs: it is killed and started again.
    /// 50: five seconds at 10 Hz, ten times what a stage ever took for a frame. 0: nothing is taken for hung.
    pub hang_after_frames: u64,
    /// Whether mapper and sinks keep a journal on disk, from which one that was killed without a standby goes on.
    pub journal: bool,
    /// Folder of the journals [default: in the domain's folder, under `/tmp`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state_dir: Option<PathBuf>,
    /// A journal that would grow beyond this is given up, MiB: 12 bytes a voxel, twice, and 16 MiB.
    pub journal_max_mib: f64,
}

impl Default for Supervision {
    fn default() -> Self {
        Self { hang_after_frames: 50, journal: true, state_dir: None, journal_max_mib: 1024.0 }
    }
}

impl Supervision {
    /// Whether everything is as without the table.
    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }

    pub(crate) fn check(&self) -> Result<(), String> {
        if self.hang_after_frames > 0 && self.hang_after_frames < 5 {
            return Err(format!(
                "supervision.hang_after_frames = {} would kill a stage that is only busy; use 5 or more, or 0 for never",
                self.hang_after_frames
            ));
        }
        if !(self.journal_max_mib >= 1.0 && self.journal_max_mib <= 1_048_576.0) {
            return Err(format!(
                "supervision.journal_max_mib = {} must lie between 1 and 1048576; journal = false keeps none",
                self.journal_max_mib
            ));
        }
        Ok(())
    }
}

/// `[stage.scheduling]`: how the kernel runs the process of one stage. What is set is read back; a stage that does not get it
/// does not start.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scheduling {
    /// Priority among real-time processes (`SCHED_FIFO`), 1 to 99; 0: not a real-time process.
    pub fifo_priority: u32,
    /// Processors that it may run on, counted from 0; none: all.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cpus: Vec<u32>,
    /// Whether its memory stays in RAM once it was touched.
    pub lock_memory: bool,
}

impl Scheduling {
    /// Highest number of a processor that can be named.
    pub const MAX_CPU: u32 = 1023;

    pub(crate) fn check(&self) -> Result<(), String> {
        if self.fifo_priority > 99 {
            return Err(format!(
                "scheduling.fifo_priority = {} must lie between 0 (not real-time) and 99; 10 suits a stage, 50 and more is where the kernel's own threads run",
                self.fifo_priority
            ));
        }
        if let Some(cpu) = self.cpus.iter().find(|cpu| **cpu > Self::MAX_CPU) {
            return Err(format!("scheduling.cpus has {cpu}, which is above {}", Self::MAX_CPU));
        }
        Ok(())
    }
}

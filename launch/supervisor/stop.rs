//! How a pipeline is stopped: in the order of the data's flow, and no child outlives the launcher.

use std::time::{Duration, Instant};

use rustix::process::Signal;

use super::{POLL, Supervisor};
use crate::error::LaunchError;
use crate::registry::Role;

/// How long a stage may take to end after SIGTERM; sinks write their files in this time.
const STOP_PATIENCE: Duration = Duration::from_secs(60);

impl Supervisor {
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

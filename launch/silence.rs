//! A producer has no input that goes on while it hangs. What shows is that it does not report any more, as each does every second whether
//! its device says something or not.

use std::time::{Duration, Instant};

use crate::health_board::HealthBoard;
use crate::registry::Role;
use crate::slot::Slot;

/// A producer that has reported nothing for so long hangs: ten of its reports.
const PATIENCE: Duration = Duration::from_secs(10);
/// No more of the time since the last look is counted: the launcher itself may have been stopped, and all others with it.
const MOST_AT_ONCE: Duration = Duration::from_millis(500);

/// For how long producers have been silent.
#[derive(Debug, Default)]
pub(crate) struct Silence {
    looked: Option<Instant>,
    /// Process and time of the newest report, and the silence since, by slot.
    stages: Vec<((u32, i64), Duration)>,
}

impl Silence {
    /// Producers that hang, by slot, with the reason. Executables of others report as they will.
    pub(crate) fn hung(&mut self, slots: &[Slot], board: &HealthBoard) -> Vec<(usize, String)> {
        let now = Instant::now();
        let passed = self.looked.replace(now).map_or(Duration::ZERO, |then| now - then).min(MOST_AT_ONCE);
        self.stages.resize(slots.len(), ((0, 0), Duration::ZERO));
        let mut hung = Vec::new();
        for (index, (slot, (newest, silence))) in slots.iter().zip(&mut self.stages).enumerate() {
            let Some(health) = board.of(slot.name(), slot.epoch) else { continue };
            if slot.role != Role::Producer || slot.entry.run.is_some() {
                continue;
            }
            let report = (health.pid, health.reported_ns);
            *silence = if *newest == report { *silence + passed } else { Duration::ZERO };
            *newest = report;
            if *silence > PATIENCE {
                let (name, seconds) = (slot.name(), PATIENCE.as_secs());
                hung.push((index, format!("stage '{name}' hangs: it has not reported for {seconds} s")));
            }
        }
        hung
    }
}

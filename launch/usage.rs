//! What a process takes of the machine.

use std::collections::BTreeMap;
use std::time::Instant;

use crate::cpu::{cpu_s, share};

/// CPU and memory of a process.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Usage {
    /// Percent of one core since the last look, or since its start where there was none.
    pub(crate) cpu_percent: f64,
    /// Memory of its own, bytes.
    pub(crate) own_bytes: u64,
    /// Memory that it has touched and shares with other processes, bytes.
    pub(crate) shared_bytes: u64,
}

/// Looks at processes again and again.
#[derive(Debug, Default)]
pub(crate) struct Usages {
    /// CPU time at the last look.
    last: BTreeMap<u32, (f64, Instant)>,
}

impl Usages {
    /// `None` for a process that has ended.
    pub(crate) fn of(&mut self, pid: u32) -> Option<Usage> {
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let (used_s, now) = (cpu_s(pid)?, Instant::now());
        let since_start = share(pid)?;
        let cpu_percent = match self.last.insert(pid, (used_s, now)) {
            Some((then_s, then)) if now > then => (used_s - then_s) / (now - then).as_secs_f64() * 100.0,
            _ => since_start,
        };
        let [own_bytes, shared_bytes] = memory(&status);
        Some(Usage { cpu_percent, own_bytes, shared_bytes })
    }
}

/// Bytes of its own and shared ones, from /proc/PID/status.
fn memory(status: &str) -> [u64; 2] {
    let kib = |key: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(key));
        line.and_then(|rest| rest.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0)
    };
    [kib("RssAnon:") * 1024, (kib("RssShmem:") + kib("RssFile:")) * 1024]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_of_its_own_and_shared_memory_are_told_apart() {
        let status =
            "Name:\tevac\nVmRSS:\t 12000 kB\nRssAnon:\t 2000 kB\nRssFile:\t 4000 kB\nRssShmem:\t 6000 kB\n";
        assert_eq!(memory(status), [2000 * 1024, 10_000 * 1024]);
    }

    #[test]
    fn the_second_look_says_what_was_used_between_the_two() {
        let (mut usages, pid) = (Usages::default(), std::process::id());
        let start = Instant::now();
        assert!(usages.of(pid).is_some_and(|usage| usage.own_bytes > 0));
        while start.elapsed().as_millis() < 300 {
            std::hint::spin_loop();
        }
        assert!(usages.of(pid).is_some_and(|usage| usage.cpu_percent > 0.0));
        assert_eq!(usages.of(u32::MAX), None);
    }
}

//! What the kernel says of a process.

use std::path::PathBuf;

use serde::Serialize;

use crate::error::LaunchError;

/// Memory and work of a process.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub(super) struct ProcessFigures {
    /// Resident memory, shared memory that it has touched included, MB (10^6 bytes).
    pub(super) resident_mb: f64,
    /// The most that was resident at any time, MB.
    pub(super) peak_mb: f64,
    /// Resident memory of its own, without shared memory and files, MB.
    pub(super) own_mb: f64,
    /// Time that it has computed since its start, seconds.
    pub(super) cpu_s: f64,
}

impl ProcessFigures {
    /// Reads them from `/proc`.
    pub(super) fn of(pid: u32) -> Result<Self, LaunchError> {
        let status = read(pid, "status")?;
        let megabytes = |key: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(key));
            let kibibytes = line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok());
            kibibytes.map_or(f64::NAN, |kibibytes| kibibytes * 1024.0 * 1e-6)
        };
        Ok(Self {
            resident_mb: megabytes("VmRSS:"),
            peak_mb: megabytes("VmHWM:"),
            own_mb: megabytes("RssAnon:"),
            cpu_s: cpu_s(&read(pid, "stat")?),
        })
    }
}

/// User and system time of `/proc/PID/stat`. The name in it may hold anything, but ends at the last bracket.
fn cpu_s(stat: &str) -> f64 {
    let after_name = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    let ticks: f64 =
        after_name.split_whitespace().skip(11).take(2).filter_map(|n| n.parse::<f64>().ok()).sum();
    ticks / rustix::param::clock_ticks_per_second() as f64
}

fn read(pid: u32, file: &str) -> Result<String, LaunchError> {
    let path = PathBuf::from(format!("/proc/{pid}/{file}"));
    std::fs::read_to_string(&path)
        .map_err(|cause| LaunchError::Silent(format!("{}: {cause}; the stage has ended", path.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_process_has_memory_and_its_time_is_read_behind_a_strange_name() {
        let own = ProcessFigures::of(std::process::id()).unwrap();
        assert!(
            own.resident_mb > 0.5 && own.peak_mb >= own.resident_mb && own.own_mb <= own.resident_mb,
            "{own:?}"
        );
        let ticks = rustix::param::clock_ticks_per_second() as f64;
        assert_eq!(cpu_s("12 (a) b 1 (c)) S 1 2 3 4 5 6 7 8 9 10 300 200 0 0"), 500.0 / ticks);
    }
}

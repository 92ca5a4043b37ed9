//! How much of a core each stage takes.

use std::collections::BTreeMap;

use rustix::param::clock_ticks_per_second;

use crate::health_board::HealthBoard;

/// Share of a core that each stage has taken since its start, percent; stages that have ended are left out.
pub(crate) fn shares(board: &HealthBoard) -> BTreeMap<String, f64> {
    board.all().filter_map(|(name, health)| Some((name.to_owned(), share(health.pid)?))).collect()
}

/// CPU time that a process has taken, user and system, seconds; `None` where it has ended.
pub(crate) fn cpu_s(pid: u32) -> Option<f64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in brackets may hold spaces and brackets; user and system time are fields 14 and 15 of proc(5).
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
    if fields.next()? == "Z" {
        return None;
    }
    let mut fields = fields.skip(10);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some((ticks()? + ticks()?) / clock_ticks_per_second() as f64)
}

/// Share of a core that a process has taken since its start, percent.
pub(crate) fn share(pid: u32) -> Option<f64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let uptime = std::fs::read_to_string("/proc/uptime").ok()?;
    percent(&stat, uptime.split_whitespace().next()?.parse().ok()?, clock_ticks_per_second() as f64)
}

/// From a line of /proc/PID/stat, the seconds since boot and the ticks of a second.
fn percent(stat: &str, uptime_s: f64, ticks: f64) -> Option<f64> {
    // The name in brackets may hold spaces and brackets.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    // Numbers of the fields in proc(5), less the three before and the one from which it counts.
    let field = |number: usize| fields.get(number - 3)?.parse::<f64>().ok();
    let (user, system, start) = (field(14)?, field(15)?, field(22)?);
    let age_s = uptime_s - start / ticks;
    (age_s > 0.0).then(|| ((user + system) / ticks / age_s * 1e4).round() * 1e-2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_s_line_gives_its_share_of_a_core_since_its_start() {
        let stat = "7 (a) b) S 1 7 7 0 -1 4194304 100 0 0 0 150 50 0 0 20 0 1 0 10000 1 1 1";
        assert_eq!(percent(stat, 120.0, 100.0), Some(10.0));
        assert_eq!(percent(stat, 90.0, 100.0), None);
        // The parent, which is not so young that its age would be 0 ticks.
        assert!(share(std::os::unix::process::parent_id()).is_some());
        assert_eq!(percent("", 1.0, 100.0), None);
    }
}

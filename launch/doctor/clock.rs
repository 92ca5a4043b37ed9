//! The clocks that stamps are made with.

use std::path::Path;
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

use super::finding::Finding;

const TOPIC: &str = "clock";
/// Sources that are read without a system call.
const FAST: [&str; 4] = ["tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page"];
const WATCHED: Duration = Duration::from_secs(1);
/// Changes of the wall clock against the monotonic one that are no slewing, nanoseconds.
const STEP_NS: i64 = 1_000_000;
/// NTP slews by at most 500 ppm; so much is felt when clocks are fitted.
const SLEW_PPM: f64 = 200.0;

/// Where time comes from, and whether somebody is turning it.
pub(crate) fn look(root: &Path) -> Vec<Finding> {
    let path = root.join("sys/devices/system/clocksource/clocksource0/current_clocksource");
    let source = std::fs::read_to_string(path).map(|text| judge_source(text.trim()));
    let (wall, raw) = offsets();
    std::thread::sleep(WATCHED);
    let (wall_later, raw_later) = offsets();
    source.into_iter().chain([judge_turning(wall_later - wall, raw_later - raw)]).collect()
}

fn judge_source(source: &str) -> Finding {
    if FAST.contains(&source) {
        return Finding::good(TOPIC, format!("source {source}"));
    }
    let text = format!("source {source}: each look at the clock is a slow system call");
    Finding::advice(
        TOPIC,
        text,
        "boot with clocksource=tsc, if the kernel trusts it (dmesg | grep clocksource)",
    )
}

/// Wall clock minus monotonic, and monotonic minus raw, nanoseconds.
fn offsets() -> (i64, i64) {
    let ns = |clock| {
        let time = clock_gettime(clock);
        time.tv_sec * 1_000_000_000 + time.tv_nsec
    };
    let monotonic = ns(ClockId::Monotonic);
    (ns(ClockId::Realtime) - monotonic, monotonic - ns(ClockId::MonotonicRaw))
}

/// What a second has changed in the offsets.
fn judge_turning(wall_ns: i64, raw_ns: i64) -> Finding {
    let slew_ppm = raw_ns as f64 / WATCHED.as_secs_f64() * 1e-3;
    if wall_ns.abs() > STEP_NS {
        let text = format!("the wall clock stepped by {:.1} ms in a second", wall_ns as f64 * 1e-6);
        let remedy = "let NTP or PTP settle first (`chronyc tracking`, `timedatectl`): a LiDAR that follows it would step too";
        return Finding::advice(TOPIC, text, remedy);
    }
    if slew_ppm.abs() > SLEW_PPM {
        let text = format!("NTP turns the monotonic clock by {slew_ppm:.0} ppm");
        return Finding::advice(TOPIC, text, "wait until it has settled (`chronyc tracking`, `timedatectl`)");
    }
    Finding::good(TOPIC, format!("steady: turned by {slew_ppm:.1} ppm, wall clock not stepped"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::finding::Grade;

    #[test]
    fn steps_and_hard_slewing_are_told_from_a_steady_clock() {
        assert_eq!(judge_turning(20_000, 30_000).grade, Grade::Good);
        assert!(judge_turning(-40_000_000, 0).text.contains("-40.0 ms"));
        assert!(judge_turning(400_000, -450_000).text.contains("-450 ppm"));
        assert_eq!(judge_source("tsc").grade, Grade::Good);
        assert_eq!(judge_source("hpet").grade, Grade::Advice);
    }
}

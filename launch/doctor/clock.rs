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
/// A sleep for measuring how late it ends.
const NAP: Duration = Duration::from_millis(2);
/// Later wake-ups than this, half of a sample's period and more, show in the IMU's stamps, nanoseconds.
const LATE_NS: i64 = 5_000_000;
/// A look that takes longer is a system call, nanoseconds.
const SLOW_NS: i64 = 500;
/// NTP slews by at most 500 ppm; so much is felt when clocks are fitted.
const SLEW_PPM: f64 = 200.0;

/// Where time comes from, and whether somebody is turning it.
pub(crate) fn look(root: &Path) -> Vec<Finding> {
    let path = root.join("sys/devices/system/clocksource/clocksource0/current_clocksource");
    let source = std::fs::read_to_string(path).map(|text| judge_source(text.trim()));
    let (wall, raw) = offsets();
    std::thread::sleep(WATCHED);
    let (wall_later, raw_later) = offsets();
    let quality = judge_quality(read_ns(), wake_up_ns());
    source.into_iter().chain([judge_turning(wall_later - wall, raw_later - raw), quality]).collect()
}

/// What a look at the monotonic clock costs, nanoseconds: the median of some.
fn read_ns() -> i64 {
    const READS: i64 = 1000;
    let mut times: Vec<_> = (0..9)
        .map(|_| {
            let began = monotonic_ns();
            let last = (0..READS).fold(began, |_, _| monotonic_ns());
            (last - began) / READS
        })
        .collect();
    times.sort_unstable();
    times[times.len() / 2]
}

/// How much later than asked a sleep ends, nanoseconds: the second worst of fifty.
fn wake_up_ns() -> i64 {
    let mut late: Vec<_> = (0..50)
        .map(|_| {
            let began = monotonic_ns();
            std::thread::sleep(NAP);
            monotonic_ns() - began - NAP.as_nanos() as i64
        })
        .collect();
    late.sort_unstable();
    late[late.len() - 2]
}

fn monotonic_ns() -> i64 {
    let time = clock_gettime(ClockId::Monotonic);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

fn judge_quality(read_ns: i64, late_ns: i64) -> Finding {
    let text = format!("a look takes {read_ns} ns; a sleep ends up to {:.1} ms late", late_ns as f64 * 1e-6);
    if late_ns > LATE_NS {
        let remedy = "end what else keeps the machine busy: an IMU's bytes are stamped when a process wakes up for them";
        return Finding::advice(TOPIC, text, remedy);
    }
    if read_ns > SLOW_NS {
        return Finding::advice(TOPIC, text, "boot with clocksource=tsc, if the kernel trusts it");
    }
    Finding::good(TOPIC, text)
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

    #[test]
    fn a_clock_that_is_slow_to_read_and_a_machine_that_wakes_late_are_advised_on() {
        assert_eq!(judge_quality(30, 300_000).grade, Grade::Good);
        assert!(judge_quality(30, 12_000_000).text.contains("12.0 ms late"));
        assert_eq!(judge_quality(30, 12_000_000).grade, Grade::Advice);
        assert_eq!(judge_quality(900, 300_000).grade, Grade::Advice);
        assert!((0..1_000_000).contains(&read_ns()) && wake_up_ns() >= 0);
    }
}

//! From a scan's last byte to its pose and to the plan, on a machine that has other work to do, with and without real-time
//! priority for the stages; and how long stages take to start. See benches/README.md for what is timed.

#[path = "support/pipeline.rs"]
mod pipeline;
#[path = "support/plot.rs"]
mod plot;
mod support;
#[path = "support/traces.rs"]
mod traces;

use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use evac_frames::Health;
use evac_picture::LineChart;
use evac_ports::services::HealthStatus;
use evac_ports::{Bus, Domain, RecordSubscriber, quiet_middleware};

use crate::pipeline::{EVAC, Running};
use crate::plot::{distributions, plot};
use crate::support::{Distribution, is_trial, print_heading};
use crate::traces::Traces;

/// Stages whose end of a frame is of interest.
const ENDS: [(&str, &str); 2] = [("lio", "pose"), ("grid_exporter", "plan")];
/// Frames that are left out: the walker stands.
const LEFT_OUT: u64 = 40;
const PATIENCE: Duration = Duration::from_secs(60);
/// What a stage gets by `chrt`: above all that is not real-time.
const PRIORITY: &str = "10";

/// What else the machine does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Load {
    None,
    /// Two threads a core that never rest.
    Busy,
    /// The same, and the stages have real-time priority.
    BusyRealTime,
}

fn main() -> anyhow::Result<()> {
    quiet_middleware(true);
    let frames = if is_trial() { 10 } else { 300 };
    let mut results = Vec::new();
    for (name, load) in
        [("no load of ours", Load::None), ("load", Load::Busy), ("load, real-time", Load::BusyRealTime)]
    {
        if let Some(times) = walk(load, frames)? {
            results.push((name, times));
        } else {
            println!("skipped: {name}: chrt is not allowed to give real-time priority, or not there");
        }
    }
    print_heading("from a scan's last byte");
    let mut panels = Vec::new();
    for (index, (_, end)) in ENDS.iter().enumerate() {
        let mut shown = Vec::new();
        for (name, times) in &results {
            let mut distribution = Distribution::default();
            times[index].iter().for_each(|ns| distribution.record(*ns));
            if let Some(summary) = distribution.summary() {
                println!("{:<34} {summary}", format!("to the {end}, {name}"));
            }
            let logarithms = times[index].iter().map(|ns| (*ns as f64 * 1e-6).max(1e-3).log10());
            shown.push((*name, logarithms.collect()));
        }
        panels.push(distributions(format!("share of frames, to the {end}"), shown));
    }
    let title = "From a scan's last byte to its pose and to the plan".to_owned();
    plot("under_load", &LineChart { title, x_label: "log10 of ms".to_owned(), panels })?;
    starts()
}

/// Latencies of the frames of a walk to each end, nanoseconds; none where priorities cannot be given.
fn walk(load: Load, frames: usize) -> anyhow::Result<Option<[Vec<i64>; 2]>> {
    let domain = Domain::new(&format!("bench-load-{}", std::process::id()))?;
    let traces = Traces::open(&domain)?;
    let running = Running::start(domain)?;
    let (mut times, mut begins, mut spinners) = ([Vec::new(), Vec::new()], None, None);
    let mut refused = false;
    traces.follow(PATIENCE + Duration::from_millis(500) * frames as u32, |trace| {
        // The load comes when everything runs, and what was under way by then is left out.
        if begins.is_none() && trace.seq >= if is_trial() { 5 } else { LEFT_OUT } {
            if load == Load::BusyRealTime && !prioritise(&running)? {
                refused = true;
                return Ok(true);
            }
            spinners = (load != Load::None).then(Spinners::start);
            begins = Some(trace.seq + 5);
        }
        let name = Health::text_of(&trace.name);
        let end = ENDS.iter().position(|(stage, _)| *stage == name);
        if let Some(end) = end.filter(|_| begins.is_some_and(|begin| trace.seq >= begin)) {
            times[end].push(trace.done_ns - trace.arrival_ns);
        }
        Ok(times.iter().all(|times| times.len() >= frames))
    })?;
    drop(spinners);
    // Leaves the domain before the launcher removes it.
    drop(traces);
    drop(running);
    Ok((!refused).then_some(times))
}

/// Gives every stage real-time priority; false where that is not allowed.
fn prioritise(running: &Running) -> anyhow::Result<bool> {
    let status = running.status()?;
    for stage in status.as_object().context("evac status gives no stages")?.values() {
        let pid = stage["pid"].to_string();
        let chrt = Command::new("chrt")
            .args(["--fifo", "--all-tasks", "--pid", PRIORITY, &pid])
            .stderr(Stdio::null())
            .status();
        if !chrt.is_ok_and(|status| status.success()) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Threads that never rest; dropping them ends them.
struct Spinners(Arc<AtomicBool>, Vec<std::thread::JoinHandle<()>>);

impl Spinners {
    fn start() -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let cores = std::thread::available_parallelism().map_or(2, usize::from);
        let threads = (0..2 * cores).map(|_| {
            let stop = stop.clone();
            std::thread::spawn(move || while !stop.load(Ordering::Relaxed) {})
        });
        let threads = threads.collect();
        Self(stop, threads)
    }
}

impl Drop for Spinners {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
        for thread in self.1.drain(..) {
            // A thread that only looks at a flag does not panic.
            let _ = thread.join();
        }
    }
}

/// From a stage's start to its report that all its ports are open.
fn starts() -> anyhow::Result<()> {
    let domain = Domain::new(&format!("bench-start-{}", std::process::id()))?;
    let _lock = domain.lock()?;
    let bus = Bus::join(&domain, "bench")?;
    let (health, listener) = RecordSubscriber::<HealthStatus>::open(&bus)?;
    print_heading("from a stage's start to its first report");
    let mut shown = Vec::new();
    for kind in ["deskewer", "lio", "octree_mapper", "grid_exporter", "map_saver"] {
        let (mut times, mut milliseconds) = (Distribution::default(), Vec::new());
        for _ in 0..if is_trial() { 1 } else { 20 } {
            let started = Instant::now();
            let child = Command::new(EVAC).args(["stage", kind, "--domain", domain.name()]).spawn()?;
            let mut stage = Stage(child);
            let pid = stage.0.id();
            let reported = |health: &RecordSubscriber<HealthStatus>| -> anyhow::Result<bool> {
                while let Some(report) = health.receive()? {
                    if report.pid == pid {
                        return Ok(true);
                    }
                }
                Ok(false)
            };
            while !reported(&health)? {
                anyhow::ensure!(stage.0.try_wait()?.is_none(), "the stage {kind} has ended");
                listener.wait(Duration::from_secs(1))?;
            }
            let elapsed = started.elapsed();
            times.record(elapsed.as_nanos() as i64);
            milliseconds.push(elapsed.as_secs_f64() * 1e3);
        }
        if let Some(summary) = times.summary() {
            println!("{kind:<34} {summary}");
        }
        shown.push((kind, milliseconds));
    }
    let title = "From a stage's start until all its ports are open".to_owned();
    let panels = vec![distributions("share of starts", shown)];
    plot("stage_start", &LineChart { title, x_label: "ms".to_owned(), panels })
}

/// A stage by itself; dropping it ends it.
struct Stage(Child);

impl Drop for Stage {
    fn drop(&mut self) {
        // Killed rather than told: what it leaves is removed with the domain.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

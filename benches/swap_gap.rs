//! The gap that a swap leaves: time between two frames of a stage in a live pipeline, usually and where the second one is the first of
//! another instance. See benches/README.md for what is timed.

#[path = "support/pipeline.rs"]
mod pipeline;
#[path = "support/plot.rs"]
mod plot;
mod support;
#[path = "support/traces.rs"]
mod traces;

use std::collections::BTreeMap;
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use anyhow::anyhow;
use evac_frames::{Health, Trace};
use evac_picture::LineChart;
use evac_ports::{Domain, quiet_middleware};

use crate::pipeline::{EVAC, Running};
use crate::plot::{distributions, plot};
use crate::support::{Distribution, is_trial, print_heading};
use crate::traces::Traces;

/// Swapped in turn, each for one of its own kind.
const STAGES: [&str; 5] = ["deskewer", "lio", "octree_mapper", "grid_exporter", "map_saver"];
const ROUNDS: usize = 5;
/// Frames before the first swap: the walker stands.
const LEFT_OUT: u64 = 40;
/// Frames after the last one, so that its cut is seen.
const AFTERWARDS: u64 = 10;
const PATIENCE: Duration = Duration::from_secs(600);

/// Times of one stage, nanoseconds.
#[derive(Debug, Default)]
struct Stage {
    newest: Option<Trace>,
    usual: Vec<i64>,
    across: Vec<i64>,
    lost: u64,
    doubled: u64,
}

impl Stage {
    fn take(&mut self, trace: &Trace) {
        let Some(before) = self.newest.replace(*trace) else { return };
        let gap_ns = trace.done_ns - before.done_ns;
        let gaps = if trace.epoch == before.epoch { &mut self.usual } else { &mut self.across };
        gaps.push(gap_ns);
        self.lost += trace.seq.saturating_sub(before.seq + 1);
        self.doubled += u64::from(trace.seq <= before.seq);
    }
}

fn main() -> anyhow::Result<()> {
    quiet_middleware(true);
    let (rounds, left_out) = if is_trial() { (1, 5) } else { (ROUNDS, LEFT_OUT) };
    let domain = Domain::new(&format!("bench-swap-{}", std::process::id()))?;
    let traces = Traces::open(&domain)?;
    let running = Running::start(domain.clone())?;
    let (mut swapped, mut last) = (None::<Receiver<_>>, None);
    let mut stages: BTreeMap<String, Stage> = BTreeMap::new();
    let mut durations = BTreeMap::new();
    traces.follow(PATIENCE, |trace| {
        let name = Health::text_of(&trace.name);
        if trace.seq < left_out || !STAGES.contains(&name.as_str()) {
            return Ok(false);
        }
        stages.entry(name).or_default().take(trace);
        let swapped = swapped.get_or_insert_with(|| start_swapping(&domain, rounds));
        if last.is_none()
            && let Ok(all) = swapped.try_recv()
        {
            (durations, last) = (all?, Some(trace.seq + AFTERWARDS));
        }
        Ok(last.is_some_and(|last| trace.seq >= last))
    })?;
    // Leaves the domain before the launcher removes it.
    drop(traces);
    drop(running);
    report(&stages, &durations)
}

/// How long `evac swap` took, by stage.
type Durations = BTreeMap<&'static str, Distribution>;

/// Swaps one stage after the other in a thread of its own.
fn start_swapping(domain: &Domain, rounds: usize) -> Receiver<anyhow::Result<Durations>> {
    let (done, receiver) = channel();
    let domain = domain.clone();
    std::thread::spawn(move || {
        // Who has given up does not listen.
        let _ = done.send(swap_all(&domain, rounds));
    });
    receiver
}

fn swap_all(domain: &Domain, rounds: usize) -> anyhow::Result<Durations> {
    let mut durations = Durations::new();
    for stage in STAGES.iter().cycle().take(rounds * STAGES.len()) {
        let started = Instant::now();
        let output = Command::new(EVAC)
            .args(["swap", stage, "--domain", domain.name()])
            .stdin(Stdio::null())
            .output()?;
        if !output.status.success() {
            return Err(anyhow!("evac swap {stage}: {}", String::from_utf8_lossy(&output.stderr)));
        }
        durations.entry(*stage).or_default().record(started.elapsed().as_nanos() as i64);
    }
    Ok(durations)
}

fn report(stages: &BTreeMap<String, Stage>, durations: &Durations) -> anyhow::Result<()> {
    print_heading("time between two frames of a stage; a frame comes every 100 ms");
    for name in STAGES {
        let Some(stage) = stages.get(name) else { continue };
        for (what, gaps) in [("usually", &stage.usual), ("across a swap", &stage.across)] {
            let mut distribution = Distribution::default();
            gaps.iter().for_each(|ns| distribution.record(*ns));
            if let Some(summary) = distribution.summary() {
                println!("{:<34} {summary}", format!("{name}, {what}"));
            }
        }
        if let Some(summary) = durations.get(name).and_then(Distribution::summary) {
            println!("{:<34} {summary}", format!("{name}, evac swap in all"));
        }
        println!("{:<34} {} lost, {} doubled", format!("{name}, frames"), stage.lost, stage.doubled);
    }
    let milliseconds = |gaps: fn(&Stage) -> &Vec<i64>| {
        stages.values().flat_map(gaps).map(|ns| *ns as f64 * 1e-6).collect::<Vec<_>>()
    };
    let panel = distributions(
        "share of frames, all stages",
        [
            ("usually", milliseconds(|stage| &stage.usual)),
            ("across a swap", milliseconds(|stage| &stage.across)),
        ],
    );
    let title = "Time between two frames of a stage".to_owned();
    plot("swap_gap", &LineChart { title, x_label: "ms".to_owned(), panels: vec![panel] })
}

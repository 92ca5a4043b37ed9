//! What IPC adds up to from a LiDAR's frame to its pose and to the plan, through the real processes of a live pipeline, beside
//! processes that make the same hops by iceoryx2 alone, in between. See benches/README.md for what is timed.

mod bare;
#[path = "../support/pipeline.rs"]
mod pipeline;
#[path = "../support/plot.rs"]
mod plot;
#[path = "../support/mod.rs"]
mod support;
#[path = "../support/traces.rs"]
mod traces;

use std::collections::BTreeMap;
use std::time::Duration;

use anyhow::anyhow;
use evac_frames::Health;
use evac_picture::LineChart;
use evac_ports::{Domain, quiet_middleware};

use crate::bare::{Chain, HOPS};
use crate::pipeline::Running;
use crate::plot::{distributions, plot};
use crate::support::{Distribution, is_trial, print_heading};
use crate::traces::Traces;

/// Readers of the hops, in order; the mapper is the poses' consumer.
const READERS: [&str; HOPS] = ["deskewer", "lio", "octree_mapper", "grid_exporter"];
/// Hops up to the pose's consumer.
const TO_POSE: usize = 3;
/// Frames that are left out: the walker stands.
const LEFT_OUT: u64 = 40;
const PATIENCE: Duration = Duration::from_secs(60);

fn main() -> anyhow::Result<()> {
    if bare::serve_if_link()? {
        return Ok(());
    }
    quiet_middleware(true);
    let (frames, left_out) = if is_trial() { (10, 5) } else { (400, LEFT_OUT) };
    let own = Domain::new(&format!("bench-chain-{}", std::process::id()))?;
    let other = Domain::new(&format!("bench-bare-{}", std::process::id()))?;
    // Dropped last: it removes what the domain left behind.
    let _lock = other.lock()?;
    let traces = Traces::open(&own)?;
    let running = Running::start(own)?;
    // Half a period apart, so that neither has to wait for a core that the other uses.
    let phase_ns = scan_sent_ns(&traces)? + bare::PERIOD.as_nanos() as i64 / 2;
    let bare = std::thread::spawn(move || -> anyhow::Result<Vec<[i64; HOPS]>> {
        let chain = Chain::start(&other, phase_ns)?;
        (0..left_out as usize + frames).map(|_| chain.next()).skip(left_out as usize).collect()
    });
    let evac = follow(&traces, left_out, frames)?;
    let bare = bare.join().map_err(|_| anyhow!("the bare chain has panicked"))??;
    // Leaves the domain before the launcher removes it.
    drop(traces);
    drop(running);
    report(&evac, &bare)
}

/// When a scan was handed over.
fn scan_sent_ns(traces: &Traces) -> anyhow::Result<i64> {
    let mut sent_ns = 0;
    traces.follow(PATIENCE, |trace| {
        sent_ns = trace.sent_ns;
        Ok(Health::text_of(&trace.name) == READERS[0])
    })?;
    Ok(sent_ns)
}

/// Each frame's hops through the pipeline's stages, nanoseconds.
fn follow(traces: &Traces, from_seq: u64, frames: usize) -> anyhow::Result<Vec<[i64; HOPS]>> {
    let mut heard: BTreeMap<u64, [i64; HOPS]> = BTreeMap::new();
    let mut whole = Vec::new();
    traces.follow(PATIENCE + 3 * bare::PERIOD * frames as u32, |trace| {
        let name = Health::text_of(&trace.name);
        if let Some(hop) = READERS.iter().position(|reader| *reader == name).filter(|_| trace.seq >= from_seq)
        {
            let hops = heard.entry(trace.seq).or_default();
            hops[hop] = trace.received_ns - trace.sent_ns;
            if hops.iter().all(|hop| *hop > 0) {
                whole.extend(heard.remove(&trace.seq));
            }
        }
        Ok(whole.len() >= frames)
    })?;
    Ok(whole)
}

fn report(evac: &[[i64; HOPS]], bare: &[[i64; HOPS]]) -> anyhow::Result<()> {
    print_heading("hops of a frame, evac's stages beside iceoryx2 alone at the same time");
    for (hop, reader) in READERS.iter().enumerate() {
        for (name, frames) in [("evac", evac), ("bare", bare)] {
            line(&format!("to {reader}, {name}"), frames.iter().map(|hops| hops[hop]));
        }
    }
    let mut panels = Vec::new();
    for (what, hops) in [("to the pose's consumer", TO_POSE), ("to the plan", HOPS)] {
        let sums = |frames: &[[i64; HOPS]]| -> Vec<i64> {
            frames.iter().map(|all| all[..hops].iter().sum()).collect()
        };
        let medians = [("evac", sums(evac)), ("bare", sums(bare))]
            .map(|(name, sums)| line(&format!("{hops} hops {what}, {name}"), sums.iter().copied()));
        if let [Some(evac), Some(bare)] = medians {
            println!("{:<34} {:>9.2}x", format!("{hops} hops {what}, evac / bare"), evac / bare);
        }
        // The slowest 2 % are the other load's, and would leave no room for the rest.
        let shown = |sums: Vec<i64>| {
            let mut sums: Vec<_> = sums.into_iter().map(|ns| ns as f64 * 1e-3).collect();
            sums.sort_by(f64::total_cmp);
            sums.truncate(sums.len() * 98 / 100);
            sums
        };
        panels.push(distributions(
            format!("share of frames, {hops} hops"),
            [("evac", shown(sums(evac))), ("iceoryx2 alone", shown(sums(bare)))],
        ));
    }
    let title = "Accumulated IPC: 3 hops to the pose's consumer, 4 to the plan".to_owned();
    plot("chain", &LineChart { title, x_label: "us".to_owned(), panels })
}

/// Prints a row; gives the median, microseconds.
fn line(name: &str, nanoseconds: impl Iterator<Item = i64>) -> Option<f64> {
    let mut times = Distribution::default();
    nanoseconds.for_each(|ns| times.record(ns));
    let summary = times.summary()?;
    println!("{name:<34} {summary}");
    Some(summary.p50_us)
}

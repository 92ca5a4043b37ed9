//! What IPC adds up to from a LiDAR's frame to its pose and to the plan, through the real processes of a live pipeline, beside
//! processes that make the same hops by iceoryx2 alone, at the same time. See benches/README.md for what is timed.

mod bare;
#[path = "../support/pipeline.rs"]
mod pipeline;
#[path = "../support/plot.rs"]
mod plot;
#[path = "../support/mod.rs"]
mod support;

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::Duration;

use anyhow::anyhow;
use evac_frames::Health;
use evac_picture::{LineChart, Panel, Series, Stroke};
use evac_ports::services::FrameTrace;
use evac_ports::{Bus, Domain, RecordSubscriber, Wake, now_ns, quiet_middleware, wait_on};

use crate::bare::{Chain, HOPS};
use crate::pipeline::Running;
use crate::plot::plot;
use crate::support::{Distribution, is_trial, print_heading};

/// Readers of the hops, in order; the mapper is the poses' consumer.
const READERS: [&str; HOPS] = ["deskewer", "lio", "octree_mapper", "grid_exporter"];
/// Hops up to the pose's consumer.
const TO_POSE: usize = 3;
/// Frames that are left out: the walker stands.
const LEFT_OUT: u64 = 40;
const PATIENCE_NS: i64 = 60_000_000_000;

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
    let bare = std::thread::spawn(move || -> anyhow::Result<Vec<[i64; HOPS]>> {
        let chain = Chain::start(&other)?;
        (0..left_out + frames).map(|_| chain.next()).skip(left_out as usize).collect()
    });
    let evac = follow(&own, left_out, frames as usize)?;
    let bare = bare.join().map_err(|_| anyhow!("the bare chain has panicked"))??;
    report(&evac, &bare)
}

/// Each frame's hops through the pipeline's stages, nanoseconds.
fn follow(domain: &Domain, from_seq: u64, frames: usize) -> anyhow::Result<Vec<[i64; HOPS]>> {
    let bus = Bus::join(domain, "bench")?;
    let (traces, listener) = RecordSubscriber::<FrameTrace>::open(&bus)?;
    let running = Running::start(domain.clone())?;
    let mut heard: BTreeMap<u64, [i64; HOPS]> = BTreeMap::new();
    let mut whole = Vec::new();
    let started_ns = now_ns();
    let mut look = || -> anyhow::Result<bool> {
        while let Some(trace) = traces.receive()? {
            let name = Health::text_of(&trace.name);
            let Some(hop) = READERS.iter().position(|reader| *reader == name) else { continue };
            if trace.seq < from_seq {
                continue;
            }
            let hops = heard.entry(trace.seq).or_default();
            hops[hop] = trace.received_ns - trace.sent_ns;
            if hops.iter().all(|hop| *hop > 0) {
                whole.extend(heard.remove(&trace.seq));
            }
        }
        anyhow::ensure!(
            now_ns() - started_ns < PATIENCE_NS + frames as i64 * 300_000_000,
            "frames do not come"
        );
        Ok(whole.len() >= frames)
    };
    wait_on(&[listener], |wake| match (wake, look()) {
        (Wake::Stop, _) => ControlFlow::Break(Err(anyhow!("interrupted"))),
        (_, Err(error)) => ControlFlow::Break(Err(error)),
        (_, Ok(true)) => ControlFlow::Break(Ok(())),
        (_, Ok(false)) => ControlFlow::Continue(Duration::from_secs(1)),
    })??;
    // Leaves the domain before the launcher removes it.
    drop(traces);
    drop(bus);
    drop(running);
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
        let shares = |sums: Vec<i64>| {
            let mut sums: Vec<_> = sums.into_iter().map(|ns| ns as f64 * 1e-3).collect();
            sums.sort_by(f64::total_cmp);
            let count = sums.len() as f64;
            // The slowest 2 % are the other load's, and would leave no room for the rest.
            let shown = (count * 0.98) as usize;
            sums.into_iter().take(shown).enumerate().map(|(i, us)| [us, (i + 1) as f64 / count]).collect()
        };
        panels.push(Panel {
            y_label: format!("share of frames, {hops} hops"),
            y_range: Some([0.0, 1.0]),
            series: vec![
                Series::line("iceoryx2 alone", Stroke::truth(), shares(sums(bare))),
                Series::line("evac", Stroke::nth(0), shares(sums(evac))),
            ],
            ..Panel::default()
        });
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

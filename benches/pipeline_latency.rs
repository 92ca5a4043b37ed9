//! From a frame's last point to its pose, through the real processes of a live pipeline, and how much of it is IPC and
//! scheduling. See benches/README.md for what is timed.
#![allow(clippy::expect_used)] // criterion's closures cannot return errors

#[path = "support/pipeline.rs"]
mod pipeline;
mod support;

use std::ops::ControlFlow;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use criterion::{Criterion, SamplingMode};
use evac_ports::services::OdometryPose;
use evac_ports::{Bus, Domain, Listener, RecordSubscriber, Wake, now_ns, quiet_middleware, wait_on};
use serde_json::Value;

use crate::pipeline::Running;
use crate::support::{Distribution, Summary, print_heading};

/// A pipeline that gives no pose for this long is broken; its start is in it.
const PATIENCE_NS: i64 = 30_000_000_000;

fn main() -> anyhow::Result<()> {
    quiet_middleware(true);
    let mut criterion = Criterion::default().configure_from_args();
    let mut times = Distribution::default();
    let mut running = None;
    // Criterion does not call this for `--list` or where a filter leaves it out: then nothing is started.
    let mut group = criterion.benchmark_group("pipeline");
    group
        .sampling_mode(SamplingMode::Flat)
        .sample_size(20)
        // The walker stands for three seconds, in which the odometry initialises.
        .warm_up_time(Duration::from_secs(4))
        .measurement_time(Duration::from_secs(20));
    group.bench_function("last point to pose", |bencher| {
        let (poses, _) = running.get_or_insert_with(|| start().expect("the pipeline should start"));
        bencher.iter_custom(|frames| {
            let total_ns = poses.take(frames, &mut times).expect("poses should come");
            Duration::from_nanos(total_ns.unsigned_abs())
        });
    });
    group.finish();
    criterion.final_summary();
    let Some((poses, pipeline)) = running else { return Ok(()) };
    let status = pipeline.status()?;
    // Leaves the domain before the launcher removes it.
    drop(poses);
    drop(pipeline);
    print(&times, &status)
}

/// The subscriber comes first, so that it misses nothing, and is dropped first: the launcher removes the domain at its end.
fn start() -> anyhow::Result<(Poses, Running)> {
    let domain = Domain::new(&format!("bench-latency-{}", std::process::id()))?;
    let poses = Poses::open(&domain)?;
    let running = Running::start(domain)?;
    Ok((poses, running))
}

/// A consumer of poses, as a robot's controller would be.
struct Poses {
    port: RecordSubscriber<OdometryPose>,
    listeners: [Listener; 1],
    _bus: Bus,
}

impl Poses {
    fn open(domain: &Domain) -> anyhow::Result<Self> {
        let bus = Bus::join(domain, "bench")?;
        let (port, listener) = RecordSubscriber::open(&bus)?;
        Ok(Self { port, listeners: [listener], _bus: bus })
    }

    /// Waits for the next `count` poses; the sum of their latencies, each from the frame's last point to the pose in this
    /// process, nanoseconds.
    fn take(&self, count: u64, times: &mut Distribution) -> anyhow::Result<i64> {
        // What came while nobody waited would be measured too long.
        while self.port.receive()?.is_some() {}
        let (mut left, mut total_ns) = (count, 0);
        let mut last_news_ns = now_ns();
        let mut look = || -> anyhow::Result<bool> {
            while let Some(pose) = self.port.receive()? {
                last_news_ns = now_ns();
                let latency_ns = last_news_ns - pose.frame.arrival_ns;
                times.record(latency_ns);
                total_ns += latency_ns;
                left -= 1;
                if left == 0 {
                    return Ok(true);
                }
            }
            anyhow::ensure!(now_ns() - last_news_ns < PATIENCE_NS, "no pose comes");
            Ok(false)
        };
        wait_on(&self.listeners, |wake| match (wake, look()) {
            (Wake::Stop, _) => ControlFlow::Break(Err(anyhow!("interrupted"))),
            (_, Err(error)) => ControlFlow::Break(Err(error)),
            (_, Ok(true)) => ControlFlow::Break(Ok(())),
            (_, Ok(false)) => ControlFlow::Continue(Duration::from_secs(1)),
        })??;
        Ok(total_ns)
    }
}

/// Stages in the order in which a frame passes them.
const STAGES: [&str; 5] = ["deskewer", "lio", "octree_mapper", "grid_exporter", "map_saver"];

fn print(times: &Distribution, stages: &Value) -> anyhow::Result<()> {
    print_heading("live pipeline at 10 Hz");
    if let Some(summary) = times.summary() {
        println!("{:<34} {summary}", "last point to pose in a consumer");
    }
    for stage in STAGES {
        println!("{stage}");
        for what in ["ipc", "compute", "end_to_end"] {
            println!("  {what:<32} {}", reported(stages, stage, what)?);
        }
    }
    let p50_us = |stage, what| reported(stages, stage, what).map(|latency| latency.p50_us);
    let total = p50_us("lio", "end_to_end")?;
    let computing = p50_us("deskewer", "compute")? + p50_us("lio", "compute")?;
    let hops = p50_us("deskewer", "ipc")? + p50_us("lio", "ipc")?;
    println!("medians, from last point to pose published");
    for (part, us) in [
        ("all", total),
        ("computing (deskewer, lio)", computing),
        ("IPC (lidar -> deskewer -> lio)", hops),
        ("all but computing", total - computing),
    ] {
        println!("  {part:<32} {us:>10.1} {:>9.1}%", 100.0 * us / total);
    }
    Ok(())
}

/// A latency as the stage itself reports it, over all frames since its start.
fn reported(stages: &Value, stage: &str, what: &str) -> anyhow::Result<Summary> {
    let latency = &stages[stage]["latency"][what];
    let us = |key: &str| {
        let ms = latency[key].as_f64();
        ms.map(|ms| ms * 1e3).with_context(|| format!("evac status does not give {key} of {stage} {what}"))
    };
    let count = latency["count"].as_u64().unwrap_or(0) as usize;
    Ok(Summary { p50_us: us("p50_ms")?, p99_us: us("p99_ms")?, max_us: us("max_ms")?, count })
}

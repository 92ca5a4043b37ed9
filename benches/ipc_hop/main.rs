//! One-way hop of a frame between two processes: shared memory with a blocking wake-up, exactly as the stages use it, beside a
//! Unix stream socket that carries the same bytes. See benches/README.md for what is timed.
#![allow(clippy::expect_used)] // criterion's closures cannot return errors

mod case;
mod peer;
mod shared_memory;
mod socket;
#[path = "../support/mod.rs"]
mod support;

use std::time::Duration;

use criterion::Criterion;
use evac_ports::{Bus, Domain, quiet_middleware};

use crate::case::{Case, Link};
use crate::support::{Distribution, Summary, print_heading};

/// Round trips before anything is timed: enough to touch every page that a port reuses.
const WARM_UP_TRIPS: u64 = 64;

fn main() -> anyhow::Result<()> {
    if peer::serve_if_peer()? {
        return Ok(());
    }
    quiet_middleware(true);
    let domain = Domain::new(&format!("bench-hop-{}", std::process::id()))?;
    // Dropped last: it removes what the domain left behind.
    let _lock = domain.lock()?;
    let bus = Bus::join(&domain, "bench")?;
    let mut criterion = Criterion::default().configure_from_args();
    let mut results = Vec::new();
    for case in &Case::ALL {
        let group = format!("ipc_hop/{case}");
        let shared =
            measure(&mut criterion, &group, "shared memory", || shared_memory::connect(&bus, &domain, case));
        let socket = measure(&mut criterion, &group, "unix socket", || socket::connect(case));
        results.push((case, shared, socket));
    }
    criterion.final_summary();
    print(&results);
    Ok(())
}

/// Measures one transport; connects only when criterion asks for the first sample.
fn measure(
    criterion: &mut Criterion,
    group: &str,
    transport: &str,
    connect: impl Fn() -> anyhow::Result<Box<dyn Link>>,
) -> Option<Summary> {
    let (mut times, mut link) = (Distribution::default(), None);
    let mut group = criterion.benchmark_group(group);
    group.sample_size(50).warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(3));
    group.bench_function(transport, |bencher| {
        let link = link.get_or_insert_with(|| {
            let mut link = connect().expect("the peer should start");
            link.round_trips(WARM_UP_TRIPS, &mut |_| {}).expect("the peer should answer");
            link
        });
        bencher.iter_custom(|count| {
            let mut total_ns = 0;
            let mut record = |one_way_ns| {
                times.record(one_way_ns);
                total_ns += one_way_ns;
            };
            link.round_trips(count, &mut record).expect("the peer should answer");
            Duration::from_nanos(total_ns.unsigned_abs())
        });
    });
    group.finish();
    times.summary()
}

fn print(results: &[(&Case, Option<Summary>, Option<Summary>)]) {
    print_heading("one-way hop between two processes");
    for (case, shared, socket) in results {
        println!("{case}");
        for (name, summary) in [("  shared memory", shared), ("  unix socket", socket)] {
            if let Some(summary) = summary {
                println!("{name:<34} {summary}");
            }
        }
        if let (Some(shared), Some(socket)) = (shared, socket) {
            println!("{:<34} {:>9.2}x", "  socket / shared memory", socket.p50_us / shared.p50_us);
        }
    }
}

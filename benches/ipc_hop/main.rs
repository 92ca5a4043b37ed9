//! One-way hop of a frame between two processes: shared memory exactly as the stages use it, with other ways to wake up and with more
//! readers, beside a Unix stream socket that carries the same bytes, raw and serialised. See benches/README.md for what is timed.
#![allow(clippy::expect_used)] // criterion's closures cannot return errors

mod case;
mod peer;
#[path = "../support/plot.rs"]
mod plot;
mod postcard;
mod shared_memory;
mod socket;
#[path = "../support/mod.rs"]
mod support;

use std::time::Duration;

use criterion::Criterion;
use evac_picture::{LineChart, Panel, Series, Stroke};
use evac_ports::{Bus, Domain, quiet_middleware};

use crate::case::{Case, Link, Measure};
use crate::plot::plot;
use crate::shared_memory::WakeUp;
use crate::support::{Distribution, Summary, print_heading};

/// Round trips before anything is timed: enough to touch every page that a port reuses.
const WARM_UP_TRIPS: u64 = 64;

/// The stages' own way; the others are compared with it.
const OURS: &str = "shared memory";

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
        let shared = |wake_up, readers| shared_memory::connect(&bus, &domain, case, wake_up, readers);
        let transports: [(&str, Connect<'_>); 7] = [
            (OURS, &|| shared(WakeUp::WaitSet, 1)),
            ("shared memory, one listener", &|| shared(WakeUp::Listener, 1)),
            ("shared memory, spinning", &|| shared(WakeUp::Spin, 1)),
            ("shared memory, 2 readers", &|| shared(WakeUp::WaitSet, 2)),
            ("shared memory, 4 readers", &|| shared(WakeUp::WaitSet, 4)),
            ("unix socket", &|| socket::connect(case)),
            ("unix socket + postcard", &|| postcard::connect(case)),
        ];
        let group = format!("ipc_hop/{case}");
        for (transport, connect) in transports {
            results.push((case, transport, measure(&mut criterion, &group, transport, connect)));
        }
    }
    criterion.final_summary();
    print(&results);
    draw(&results)
}

/// What connects to a new peer.
type Connect<'a> = &'a dyn Fn() -> anyhow::Result<Box<dyn Link>>;

/// Measures one transport; connects only when criterion asks for the first sample.
fn measure(criterion: &mut Criterion, group: &str, transport: &str, connect: Connect<'_>) -> Option<Summary> {
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

type Measured<'a> = (&'a Case, &'a str, Option<Summary>);

fn print(results: &[Measured<'_>]) {
    print_heading("one-way hop between two processes");
    let mut ours = None;
    for (case, transport, summary) in results {
        if *transport == OURS {
            println!("{case}");
            ours = *summary;
        }
        if let Some(summary) = summary {
            let ratio = ours.map_or(String::new(), |ours| format!("{:>9.2}x", summary.p50_us / ours.p50_us));
            println!("  {transport:<32} {summary} {ratio}");
        }
    }
}

/// Medians over the payload, both axes logarithmic.
fn draw(results: &[Measured<'_>]) -> anyhow::Result<()> {
    let transports: Vec<_> =
        results.iter().take(results.len() / Case::ALL.len()).map(|result| result.1).collect();
    let series = transports.iter().enumerate().map(|(index, name)| {
        let points = results.iter().filter_map(|(case, transport, summary)| {
            let kib = (case.points * size_of::<evac_frames::Point>()) as f64 / 1024.0;
            let shown = transport == name && case.measure == Measure::Transport;
            summary.filter(|_| shown).map(|summary| [kib.log2(), summary.p50_us.log10()])
        });
        Series::line(*name, Stroke::nth(index), points.collect())
    });
    let panel =
        Panel { y_label: "one way, log10 of us".to_owned(), series: series.collect(), ..Panel::default() };
    plot(
        "ipc_hop",
        &LineChart {
            title: "One hop between two processes, medians".to_owned(),
            x_label: "payload, log2 of KiB (8.6 is a scan of 384 KiB)".to_owned(),
            panels: vec![panel],
        },
    )
}

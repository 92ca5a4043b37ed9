//! One-way hop of a frame between two processes: shared memory exactly as the stages use it, with other ways to wake up and with more
//! readers, beside a Unix stream socket that carries the same bytes, raw and serialised, and Zenoh's shared memory. See
//! benches/README.md for what is timed.
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
mod zenoh;

use std::time::Duration;

use criterion::Criterion;
use evac_picture::{LineChart, Panel, Series, Shape, Stroke};
use evac_ports::{Bus, Domain, quiet_middleware};

use crate::case::{Case, Link, Measure};
use crate::plot::plot;
use crate::shared_memory::WakeUp;
use crate::support::{Distribution, Summary, print_heading};
use crate::zenoh::Receive;

/// Round trips before anything is timed: enough to touch every page that a port reuses.
const WARM_UP_TRIPS: u64 = 64;

/// The stages' own way; the others are compared with it.
const OURS: &str = "shared memory";
const LISTENER: &str = "shared memory, one listener";
const SPINNING: &str = "shared memory, spinning";
const TWO_READERS: &str = "shared memory, 2 readers";
const FOUR_READERS: &str = "shared memory, 4 readers";
const SOCKET: &str = "unix socket";
const POSTCARD: &str = "unix socket + postcard";
const ZENOH: &str = "zenoh shared memory";
const ZENOH_CALLBACK: &str = "zenoh, callback, low latency";

/// The pictures: what they are of, their names, and the transports they show.
const PICTURES: [(&str, &str, &[&str]); 3] = [
    ("One hop between two processes", "hop", &[OURS, SOCKET, POSTCARD, ZENOH, ZENOH_CALLBACK]),
    ("One hop by the number of readers", "hop_readers", &[OURS, TWO_READERS, FOUR_READERS]),
    ("One hop by the way to wake up", "hop_wake_up", &[OURS, LISTENER, SPINNING]),
];

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
    let has_zenoh = zenoh::program().is_some();
    if !has_zenoh {
        println!("skipped: {ZENOH}: benches/zenoh/build has not been run");
    }
    let mut results = Vec::new();
    for case in &Case::ALL {
        let shared = |wake_up, readers| shared_memory::connect(&bus, &domain, case, wake_up, readers);
        let transports: [(&str, Connect<'_>); 9] = [
            (OURS, &|| shared(WakeUp::WaitSet, 1)),
            (LISTENER, &|| shared(WakeUp::Listener, 1)),
            (SPINNING, &|| shared(WakeUp::Spin, 1)),
            (TWO_READERS, &|| shared(WakeUp::WaitSet, 2)),
            (FOUR_READERS, &|| shared(WakeUp::WaitSet, 4)),
            (SOCKET, &|| socket::connect(case)),
            (POSTCARD, &|| postcard::connect(case)),
            (ZENOH, &|| zenoh::connect(case, Receive::Thread)),
            (ZENOH_CALLBACK, &|| zenoh::connect(case, Receive::Callback)),
        ];
        let group = format!("ipc_hop/{case}");
        let is_there = |name: &str| has_zenoh || ![ZENOH, ZENOH_CALLBACK].contains(&name);
        for (transport, connect) in transports.into_iter().filter(|(name, _)| is_there(name)) {
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
    group
        .sample_size(50)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_millis(1500));
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
    for (title, name, transports) in PICTURES {
        let series = transports.iter().enumerate().map(|(index, shown)| {
            let points = results
                .iter()
                .filter(|(case, transport, _)| transport == shown && case.measure == Measure::Transport);
            let points = points.filter_map(|(case, _, summary)| {
                let kib = (case.points * size_of::<evac_frames::Point>()) as f64 / 1024.0;
                Some([kib.log2(), (*summary)?.p50_us.log10()])
            });
            Series::line(*shown, Stroke::nth(index), points.collect())
        });
        // Where Zenoh is not built it has no line.
        let series = series.filter(|series| series.shape != Shape::Line(Vec::new())).collect();
        let panel = Panel { y_label: "one way, log10 of us".to_owned(), series, ..Panel::default() };
        let (title, x_label) =
            (format!("{title}, medians"), "payload, log2 of KiB (8.6 is a scan)".to_owned());
        plot(name, &LineChart { title, x_label, panels: vec![panel] })?;
    }
    Ok(())
}

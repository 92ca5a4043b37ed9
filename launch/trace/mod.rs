//! `evac trace`: one frame on its way through all stages.

mod passage;
mod picture;

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use evac_frames::Trace;
use evac_ports::services::FrameTrace;
use evac_ports::{Bus, Domain, RecordSubscriber, Wake, wait_on};

use crate::cli::DomainArgs;
use crate::control::stages;
use crate::error::LaunchError;
use crate::status::{domain_of, nothing_runs};
use crate::trace::passage::Passage;

/// How long stages may be behind the first that speaks of the frame.
const SLOWEST: Duration = Duration::from_secs(10);
/// How long it is waited for a first word of every stage.
const QUIET: Duration = Duration::from_secs(3);
/// Frames of which words are kept.
const KEPT: usize = 256;

#[derive(Debug, Args)]
pub(crate) struct TraceArgs {
    #[command(flatten)]
    pub(crate) domain: DomainArgs,
    /// The frame of this number, which must be still to come
    #[arg(long, value_name = "N", conflicts_with = "next")]
    pub(crate) seq: Option<u64>,
    /// The next frame; the default
    #[arg(long)]
    pub(crate) next: bool,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
    /// Also draw it
    #[arg(long, value_name = "TRACE.png")]
    pub(crate) png: Option<PathBuf>,
    /// Longest time until the frame comes
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0)]
    pub(crate) patience: f64,
}

/// `evac trace`.
pub(crate) fn trace(args: &TraceArgs) -> Result<(), LaunchError> {
    let domain = domain_of(&args.domain)?;
    domain.holder().ok_or_else(|| nothing_runs(&domain))?;
    let passage = observe(&domain, args)?;
    if let Some(path) = &args.png {
        picture::draw(&passage).write_png(path)?;
    }
    if args.json {
        println!("{:#}", passage.as_json());
    } else {
        print!("{}", passage.text());
    }
    Ok(())
}

/// Waits until every stage has spoken of the frame, or has been given the time to.
fn observe(domain: &Domain, args: &TraceArgs) -> Result<Passage, LaunchError> {
    let bus = Bus::join(domain, "trace")?;
    let (port, listener) = RecordSubscriber::<FrameTrace>::open(&bus)?;
    // A recorder takes every message of every service; a scan has no way through it.
    let expected: Vec<String> = stages(domain)
        .into_iter()
        .filter(|stage| stage.role != "producer" && stage.kind != "recorder")
        .map(|stage| stage.name)
        .collect();
    let patience = Duration::try_from_secs_f64(args.patience).unwrap_or(Duration::MAX);
    let started = Instant::now();
    let mut watch = Watch {
        wanted: args.seq,
        expected,
        newest: BTreeMap::new(),
        started,
        heard: BTreeMap::new(),
        since: None,
    };
    wait_on(&[listener], |wake| {
        let look = (|| {
            while let Some(trace) = port.receive()? {
                watch.take(trace)?;
            }
            if let Some(traces) = watch.done() {
                return Ok(Some(Passage::new(&watch.expected, traces)));
            }
            if wake == Wake::Stop || started.elapsed() > patience.saturating_add(SLOWEST) {
                return Err(watch.missed(started.elapsed()));
            }
            if watch.since.is_none() && started.elapsed() > patience {
                return Err(watch.missed(started.elapsed()));
            }
            Ok(None)
        })();
        match look {
            Ok(Some(passage)) => ControlFlow::Break(Ok(passage)),
            Ok(None) => ControlFlow::Continue(Duration::from_millis(100)),
            Err(cause) => ControlFlow::Break(Err(cause)),
        }
    })?
}

/// What was heard so far.
struct Watch {
    wanted: Option<u64>,
    expected: Vec<String>,
    /// The newest frame of each stage, until it is known which one is wanted.
    newest: BTreeMap<String, u64>,
    started: Instant,
    heard: BTreeMap<u64, Vec<Trace>>,
    /// When the wanted frame was first spoken of.
    since: Option<Instant>,
}

impl Watch {
    fn take(&mut self, trace: Trace) -> Result<(), LaunchError> {
        let name = evac_frames::Health::text_of(&trace.name);
        if !self.expected.is_empty() && !self.expected.contains(&name) {
            return Ok(());
        }
        let Some(wanted) = self.wanted else {
            self.newest.insert(name, trace.seq);
            // A stage that does not speak for so long will not speak of the next frame either.
            let all = self.newest.len() >= self.expected.len().max(1) || self.started.elapsed() > QUIET;
            // The next frame that none of them has had: a stage may be ahead of those after it.
            self.wanted = self.newest.values().max().filter(|_| all).map(|seq| seq.saturating_add(1));
            return Ok(());
        };
        if trace.seq > wanted && self.heard.is_empty() {
            return Err(LaunchError::Path(format!(
                "frame {wanted} has passed, the newest is {}; give a later one, or --next",
                trace.seq
            )));
        }
        if trace.seq == wanted {
            self.since.get_or_insert_with(Instant::now);
        }
        self.heard.entry(trace.seq).or_default().push(trace);
        if self.heard.len() > KEPT {
            self.heard.pop_first();
        }
        Ok(())
    }

    /// All words about the wanted frame, once there will be no more.
    fn done(&self) -> Option<&[Trace]> {
        let traces = self.heard.get(&self.wanted?)?;
        let spoken =
            |name: &String| traces.iter().any(|trace| evac_frames::Health::text_of(&trace.name) == *name);
        let complete = !self.expected.is_empty() && self.expected.iter().all(spoken);
        (complete || self.since.is_some_and(|since| since.elapsed() > SLOWEST)).then_some(traces)
    }

    fn missed(&self, waited: Duration) -> LaunchError {
        let which = self.wanted.map_or("a frame".to_owned(), |seq| format!("frame {seq}"));
        LaunchError::Silent(format!(
            "{which} did not come within {:.0} s; look at `evac status`, or give it longer with --patience",
            waited.as_secs_f64()
        ))
    }
}

//! When a source's next event is due: in real time, or as soon as the sinks of a lossless run have kept up.

use std::time::Duration;

use evac_config::Pipeline;
use evac_frames::{Ack, Health};
use evac_ports::services::SinkAck;
use evac_ports::{Bus, Listener, RecordSubscriber, now_ns};

use crate::{Reporter, RunError, SensorEvent, StageError};

/// Kinds of sinks, whose acknowledgements pace a lossless run.
const SINK_KINDS: &[&str] = &["grid_exporter", "map_saver", "recorder"];
/// Scans under way in a lossless run: enough to keep every stage busy, few enough for every buffer.
const WINDOW: u64 = 6;
/// Lossless: a pipeline that acknowledges nothing for this long is broken.
const PATIENCE: Duration = Duration::from_secs(60);
/// Longest sleep, after which SIGTERM is looked for.
const NAP_NS: i64 = 100_000_000;

/// What is left to do after waiting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Next {
    Go,
    /// SIGTERM has come.
    Stop,
}

/// When the next event is due.
#[derive(Debug)]
pub(crate) enum Pace {
    RealTime(Clockwork),
    /// As fast as the sinks, and no faster than the clockwork where there is one.
    Acknowledged(Box<Acks>, Option<Clockwork>),
}

/// Stamps of the stream against this machine's clock.
#[derive(Debug)]
pub(crate) struct Clockwork {
    rate: f64,
    /// Stamp of the first event and when it was due.
    start: Option<(i64, i64)>,
}

impl Pace {
    pub(crate) fn real_time(rate: Option<f64>) -> Self {
        Self::RealTime(Clockwork::new(rate.unwrap_or(1.0)))
    }

    pub(crate) fn lossless(
        rate: Option<f64>,
        bus: &Bus,
        pipeline: Option<&Pipeline>,
    ) -> Result<Self, RunError> {
        Ok(Self::Acknowledged(Box::new(Acks::open(bus, pipeline)?), rate.map(Clockwork::new)))
    }

    /// After a pause time goes on where it stood.
    pub(crate) fn resume(&mut self) {
        if let Self::RealTime(clockwork) | Self::Acknowledged(_, Some(clockwork)) = self {
            clockwork.start = None;
        }
    }

    /// Waits until `event` is due, the next scan being number `next_seq`.
    pub(crate) fn wait(
        &mut self,
        event: &SensorEvent,
        next_seq: u64,
        bus: &Bus,
        reporter: &mut Reporter,
    ) -> Result<Next, RunError> {
        match (self, event) {
            (Self::RealTime(clockwork), event) => sleep_until(clockwork.due_ns(event), bus, reporter),
            (Self::Acknowledged(acks, clockwork), SensorEvent::Scan(_)) => {
                if let Some(clockwork) = clockwork
                    && sleep_until(clockwork.due_ns(event), bus, reporter)? == Next::Stop
                {
                    return Ok(Next::Stop);
                }
                acks.wait_for(next_seq.checked_sub(WINDOW), false, bus, reporter)
            }
            // They go with the scans: between two there are few, and SIGTERM is looked for at each scan.
            (Self::Acknowledged(..), SensorEvent::Imu(_)) => Ok(Next::Go),
        }
    }

    /// Waits until what was published has been read: in real time nobody says so, and it stays until SIGTERM.
    pub(crate) fn linger(&mut self, scans: u64, bus: &Bus, reporter: &mut Reporter) -> Result<(), RunError> {
        match self {
            Self::RealTime(_) => sleep_until(i64::MAX, bus, reporter).map(|_| ()),
            Self::Acknowledged(acks, _) => {
                acks.wait_for(scans.checked_sub(1), true, bus, reporter).map(|_| ())
            }
        }
    }
}

impl Clockwork {
    fn new(rate: f64) -> Self {
        Self { rate, start: None }
    }

    /// When `event` is due, by this machine's clock; the first one is due at once.
    fn due_ns(&mut self, event: &SensorEvent) -> i64 {
        let stamp_ns = match event {
            SensorEvent::Imu(sample) => sample.stamp_ns,
            SensorEvent::Scan(header) => header.frame.end_ns,
        };
        let (first_ns, started_ns) = *self.start.get_or_insert((stamp_ns, now_ns()));
        started_ns.saturating_add((stamp_ns.saturating_sub(first_ns) as f64 / self.rate) as i64)
    }
}

/// Sleeps in pieces, so that SIGTERM is seen soon and reports go out.
fn sleep_until(due_ns: i64, bus: &Bus, reporter: &mut Reporter) -> Result<Next, RunError> {
    loop {
        if bus.stop_requested() {
            return Ok(Next::Stop);
        }
        reporter.report_if_due()?;
        let left_ns = due_ns.saturating_sub(now_ns());
        if left_ns <= 0 {
            return Ok(Next::Go);
        }
        std::thread::sleep(Duration::from_nanos(left_ns.min(NAP_NS).unsigned_abs()));
    }
}

/// How far the sinks of a lossless run are.
#[derive(Debug)]
pub(crate) struct Acks {
    port: RecordSubscriber<SinkAck>,
    listener: Listener,
    sinks: Vec<Sink>,
}

#[derive(Debug)]
struct Sink {
    /// As it stands in its acknowledgements.
    name: [u8; 24],
    /// The first frame it is not done with.
    next: u64,
    /// Whether it has written everything.
    finished: bool,
}

impl Acks {
    fn open(bus: &Bus, pipeline: Option<&Pipeline>) -> Result<Self, RunError> {
        let stages = pipeline.map_or(&[][..], |pipeline| &pipeline.stages);
        let sinks: Vec<_> = stages
            .iter()
            .filter(|stage| SINK_KINDS.contains(&stage.kind.as_str()))
            .map(|stage| Sink { name: Health::text(stage.name()), next: 0, finished: false })
            .collect();
        if sinks.is_empty() {
            return Err(RunError::Stage(StageError::Config(format!(
                "mode = \"lossless\" needs a sink that acknowledges frames; add one of: {}",
                SINK_KINDS.join(", ")
            ))));
        }
        let (port, listener) = RecordSubscriber::open(bus)?;
        Ok(Self { port, listener, sinks })
    }

    /// Waits until every sink is done with frame `seq` and, if `finished`, has written everything.
    fn wait_for(
        &mut self,
        seq: Option<u64>,
        finished: bool,
        bus: &Bus,
        reporter: &mut Reporter,
    ) -> Result<Next, RunError> {
        let needed = seq.map_or(0, |seq| seq + 1);
        let mut last_news = now_ns();
        loop {
            while let Some(ack) = self.port.receive()? {
                last_news = now_ns();
                self.take(&ack);
            }
            if bus.stop_requested() {
                return Ok(Next::Stop);
            }
            let behind = |sink: &&Sink| sink.next < needed || (finished && !sink.finished);
            let Some(slow) = self.sinks.iter().find(behind) else { return Ok(Next::Go) };
            if now_ns() - last_news > PATIENCE.as_nanos() as i64 {
                return Err(RunError::Peer(format!(
                    "the sink '{}' has not acknowledged frame {} for {} s; look at `evac status` for the stage that stopped",
                    Health::text_of(&slow.name),
                    slow.next,
                    PATIENCE.as_secs()
                )));
            }
            self.listener.wait(Duration::from_nanos(reporter.report_if_due()?.unsigned_abs()))?;
        }
    }

    fn take(&mut self, ack: &Ack) {
        if let Some(sink) = self.sinks.iter_mut().find(|sink| sink.name == ack.name) {
            (sink.next, sink.finished) = (ack.seq.saturating_add(1), ack.finished != 0);
        }
    }
}

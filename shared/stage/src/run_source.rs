//! The run loop of producers that know their whole stream: in real time, or as fast as the slowest stage.

use std::ffi::OsString;
use std::ops::ControlFlow;
use std::process::ExitCode;
use std::time::Duration;

use evac_config::{Mode, Pipeline};
use evac_frames::{Health, ImuSample, PoseFrame, ScanHeader, StageState, frame_flags};
use evac_ports::services::{Imu, LidarScan, SinkAck, TruthPose};
use evac_ports::{Bus, FramePublisher, Listener, RecordPublisher, RecordSubscriber, Wake, now_ns, wait_on};

use crate::options::Context;
use crate::run_stage::{parse_options, prepare};
use crate::{Reporter, RunError, RunOptions, SensorEvent, Source, StageError, exit_code, start_logging};

/// Kinds of sinks, whose acknowledgements pace a lossless run.
const SINK_KINDS: &[&str] = &["grid_exporter", "map_saver"];
/// Scans under way in a lossless run: enough to keep every stage busy, few enough for every buffer.
const WINDOW: u64 = 6;
/// Lossless: a pipeline that acknowledges nothing for this long is broken.
const PATIENCE: Duration = Duration::from_secs(60);

/// Runs a source of its own executable: `main` of every producer of this kind.
pub fn source_main<S: Source>(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let options = parse_options(S::NAME, args);
    start_logging(&options.log);
    exit_code(S::NAME, run_source::<S>(&options))
}

/// Runs a source until its stream has ended and, in lossless mode, every sink is done with it, or until SIGTERM comes.
///
/// # Errors
/// [`RunError`], with the process's exit code in [`RunError::code`].
pub fn run_source<S: Source>(options: &RunOptions) -> Result<(), RunError> {
    let Some((context, config)) = prepare::<S::Config>(S::NAME, options)? else { return Ok(()) };
    let source = S::new(config, &context.rig)?;
    let bus = Bus::join(&context.domain, &context.name)?;
    let mut reporter = Reporter::open(&bus, &context.name, context.epoch)?;
    reporter.expect(source.total_scans());
    let pace = match context.mode {
        Mode::Live => Pace::RealTime { rate: context.rate, start: None },
        Mode::Lossless => Pace::Acknowledged(Box::new(Acks::open(&bus, context.pipeline.as_ref())?)),
    };
    let outputs = Outputs::open(&bus, &context)?;
    let mut running = Running { source, outputs, reporter, pace, bus: &bus };
    let result = running.run();
    let (state, reason) = match &result {
        Ok(()) => (StageState::Finished, String::new()),
        Err(error) => (StageState::Failed, error.to_string()),
    };
    // The error itself is what the caller needs to see, not that it could not be reported.
    let reported = running.reporter.end(state, &reason);
    result.and(reported.map_err(RunError::from))
}

/// What is left to do after an event.
enum Next {
    Go,
    Stop,
}

struct Running<'a, S> {
    source: S,
    outputs: Outputs,
    reporter: Reporter,
    pace: Pace,
    bus: &'a Bus,
}

impl<S: Source> Running<'_, S> {
    fn run(&mut self) -> Result<(), RunError> {
        while let Some(event) = self.source.next_event()? {
            self.reporter.report_if_due()?;
            if let Next::Stop = self.pace.wait(&event, self.outputs.next_seq, self.bus)? {
                return Ok(());
            }
            match event {
                SensorEvent::Imu(sample) => self.outputs.imu(sample)?,
                SensorEvent::Scan(header) => self.scan(header)?,
            }
        }
        self.outputs.end_imu()?;
        self.reporter.end(StageState::Finished, "")?;
        self.pace.linger(self.outputs.next_seq, self.bus)
    }

    fn scan(&mut self, header: ScanHeader) -> Result<(), RunError> {
        self.reporter.begin();
        if let Some(truth) = self.source.truth() {
            self.outputs.truth(truth)?;
        }
        let complete_ns = now_ns();
        let header = self.outputs.scan(header, |index| self.source.point(index))?;
        self.reporter.done(&header.frame, complete_ns);
        Ok(())
    }
}

/// The producers' services.
struct Outputs {
    scans: FramePublisher<LidarScan>,
    imu: RecordPublisher<Imu>,
    truth: RecordPublisher<TruthPose>,
    epoch: u32,
    next_seq: u64,
    next_imu_seq: u64,
    last_imu: ImuSample,
}

impl Outputs {
    fn open(bus: &Bus, context: &Context) -> Result<Self, RunError> {
        Ok(Self {
            scans: FramePublisher::open(bus)?,
            imu: RecordPublisher::open(bus)?,
            truth: RecordPublisher::open(bus)?,
            epoch: context.epoch,
            next_seq: 0,
            next_imu_seq: 0,
            last_imu: ImuSample::default(),
        })
    }

    fn scan(
        &mut self,
        mut header: ScanHeader,
        point: impl FnMut(usize) -> evac_frames::Point,
    ) -> Result<ScanHeader, RunError> {
        header.frame.seq = self.next_seq;
        header.frame.epoch = self.epoch;
        self.scans.publish(header.points as usize, point, || {
            // The last byte of a simulated or recorded scan is here when its last point is written.
            header.frame.arrival_ns = now_ns();
            header.frame.sent_ns = header.frame.arrival_ns;
            header
        })?;
        self.next_seq += 1;
        Ok(header)
    }

    fn imu(&mut self, mut sample: ImuSample) -> Result<(), RunError> {
        sample.seq = self.next_imu_seq;
        sample.epoch = self.epoch;
        sample.arrival_ns = now_ns();
        sample.sent_ns = sample.arrival_ns;
        self.imu.publish(&sample)?;
        self.next_imu_seq += 1;
        self.last_imu = sample;
        Ok(())
    }

    /// Says that no later IMU sample will come.
    fn end_imu(&mut self) -> Result<(), RunError> {
        let mut end = self.last_imu;
        end.flags |= frame_flags::END_OF_STREAM;
        self.imu(end)
    }

    fn truth(&mut self, mut pose: PoseFrame) -> Result<(), RunError> {
        pose.frame.seq = self.next_seq;
        pose.frame.epoch = self.epoch;
        pose.frame.arrival_ns = now_ns();
        pose.frame.sent_ns = pose.frame.arrival_ns;
        Ok(self.truth.publish(&pose)?)
    }
}

/// When the next event is due.
enum Pace {
    RealTime { rate: f64, start: Option<(i64, i64)> },
    Acknowledged(Box<Acks>),
}

impl Pace {
    fn wait(&mut self, event: &SensorEvent, next_seq: u64, bus: &Bus) -> Result<Next, RunError> {
        match self {
            Self::RealTime { rate, start } => {
                let stamp_ns = match event {
                    SensorEvent::Imu(sample) => sample.stamp_ns,
                    SensorEvent::Scan(header) => header.frame.end_ns,
                };
                let (first_ns, started_ns) = *start.get_or_insert((stamp_ns, now_ns()));
                let due_ns = started_ns + ((stamp_ns - first_ns) as f64 / *rate) as i64;
                Ok(sleep_until(due_ns, bus))
            }
            Self::Acknowledged(acks) => match event {
                SensorEvent::Scan(_) => acks.wait_for(next_seq.checked_sub(WINDOW), false, bus),
                _ if bus.stop_requested() => Ok(Next::Stop),
                _ => Ok(Next::Go),
            },
        }
    }

    /// What was published stays readable until all have read it.
    fn linger(&mut self, scans: u64, bus: &Bus) -> Result<(), RunError> {
        match self {
            Self::RealTime { .. } => while let Next::Go = sleep_until(now_ns() + 1_000_000_000, bus) {},
            Self::Acknowledged(acks) => {
                acks.wait_for(scans.checked_sub(1), true, bus)?;
            }
        }
        Ok(())
    }
}

/// Sleeps in pieces, so that SIGTERM is seen within a tenth of a second.
fn sleep_until(due_ns: i64, bus: &Bus) -> Next {
    loop {
        if bus.stop_requested() {
            return Next::Stop;
        }
        let left_ns = due_ns - now_ns();
        if left_ns <= 0 {
            return Next::Go;
        }
        std::thread::sleep(Duration::from_nanos(left_ns.min(100_000_000).unsigned_abs()));
    }
}

/// How far the sinks of a lossless run are.
struct Acks {
    port: RecordSubscriber<SinkAck>,
    listener: [Listener; 1],
    /// Name, next frame to come, and whether all is written.
    sinks: Vec<(String, u64, bool)>,
}

impl Acks {
    fn open(bus: &Bus, pipeline: Option<&Pipeline>) -> Result<Self, RunError> {
        let stages = pipeline.map_or(&[][..], |pipeline| &pipeline.stages);
        let sinks: Vec<_> = stages
            .iter()
            .filter(|stage| SINK_KINDS.contains(&stage.kind.as_str()))
            .map(|stage| (stage.name().to_owned(), 0, false))
            .collect();
        if sinks.is_empty() {
            return Err(RunError::Stage(StageError::Config(format!(
                "mode = \"lossless\" needs a sink that acknowledges frames; add one of: {}",
                SINK_KINDS.join(", ")
            ))));
        }
        let (port, listener) = RecordSubscriber::open(bus)?;
        Ok(Self { port, listener: [listener], sinks })
    }

    /// Waits until every sink is done with frame `seq` and, if `finished`, has written everything.
    fn wait_for(&mut self, seq: Option<u64>, finished: bool, bus: &Bus) -> Result<Next, RunError> {
        let mut last_news = now_ns();
        let Self { port, listener, sinks } = self;
        wait_on(listener, |wake| {
            if wake == Wake::Stop || bus.stop_requested() {
                return ControlFlow::Break(Ok(Next::Stop));
            }
            loop {
                match port.receive() {
                    Ok(Some(ack)) => {
                        last_news = now_ns();
                        let name = Health::text_of(&ack.name);
                        if let Some(sink) = sinks.iter_mut().find(|sink| sink.0 == name) {
                            *sink = (name, ack.seq + 1, ack.finished != 0);
                        }
                    }
                    Ok(None) => break,
                    Err(cause) => return ControlFlow::Break(Err(cause.into())),
                }
            }
            let needed = seq.map_or(0, |seq| seq + 1);
            let Some(slow) = sinks.iter().find(|sink| sink.1 < needed || (finished && !sink.2)) else {
                return ControlFlow::Break(Ok(Next::Go));
            };
            if now_ns() - last_news > PATIENCE.as_nanos() as i64 {
                return ControlFlow::Break(Err(RunError::Peer(format!(
                    "the sink '{}' has not acknowledged frame {} for {} s; look at `evac status` for the stage that stopped",
                    slow.0,
                    slow.1,
                    PATIENCE.as_secs()
                ))));
            }
            ControlFlow::Continue(Duration::from_secs(1))
        })?
    }
}

//! The run loop of producers that know their whole stream: in real time, or as fast as the slowest stage.

use std::ffi::OsString;
use std::process::ExitCode;

use evac_config::Mode;
use evac_frames::{ImuSample, PoseFrame, ScanHeader, StageState, frame_flags};
use evac_ports::services::{Imu, LidarScan, TruthPose};
use evac_ports::{Bus, FramePublisher, PortError, RecordPublisher, now_ns};

use crate::options::Context;
use crate::pace::{Next, Pace};
use crate::stage_main::{parse_options, prepare};
use crate::step::Steps;
use crate::{Counters, Reporter, RunError, RunOptions, SensorEvent, Source, exit_code, start_logging};

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
    let mut source = S::new(config, &context.rig)?;
    source.start_at(context.first_seq);
    let bus = Bus::join(&context.domain, &context.name)?;
    let mut reporter = Reporter::open(&bus, &context.name, context.epoch)?;
    reporter.expect(source.total_scans());
    let pace = match context.mode {
        Mode::Live => Pace::real_time(context.rate),
        Mode::Lossless => Pace::lossless(context.rate, &bus, context.pipeline.as_ref(), context.first_seq)?,
    };
    let outputs = Outputs::open(&bus, &context)?;
    let steps = context.step.then(Steps::start);
    let first_seq = context.first_seq;
    let mut running = Running { source, outputs, reporter, pace, steps, bus: &bus, incomplete: 0, first_seq };
    let result = running.run();
    let (state, reason) = match &result {
        Ok(()) => (StageState::Finished, String::new()),
        Err(error) => (StageState::Failed, error.to_string()),
    };
    // The error itself is what the caller needs to see, not that it could not be reported.
    let reported = running.reporter.end(state, &reason);
    result.and(reported.map_err(RunError::from))
}

struct Running<'a, S> {
    source: S,
    outputs: Outputs,
    reporter: Reporter,
    pace: Pace,
    /// Where each scan waits for a line.
    steps: Option<Steps>,
    bus: &'a Bus,
    /// Scans with packets missing.
    incomplete: u64,
    /// Scans before this one were published by an instance that has ended.
    first_seq: u64,
}

impl<S: Source> Running<'_, S> {
    fn run(&mut self) -> Result<(), RunError> {
        while let Some(event) = self.source.next_event()? {
            self.count();
            // One that never waits for anybody reports too.
            self.reporter.report_if_due()?;
            if self.outputs.next_seq < self.first_seq {
                if self.bus.stop_requested() {
                    return Ok(());
                }
                self.outputs.pass_over(&event);
                continue;
            }
            if self.wait(&event)? == Next::Stop {
                return Ok(());
            }
            match event {
                SensorEvent::Imu(sample) => {
                    self.outputs.imu(sample)?;
                    self.steps.iter_mut().for_each(|steps| steps.sample_went(&sample));
                }
                SensorEvent::Scan(header) => self.scan(header)?,
            }
        }
        self.outputs.end_imu()?;
        self.count();
        self.reporter.end(StageState::Finished, "")?;
        let greet = || Ok(self.outputs.greet()?);
        self.pace.linger(self.outputs.next_seq, self.bus, &mut self.reporter, &greet)
    }

    /// Waits until `event` is asked for and due.
    fn wait(&mut self, event: &SensorEvent) -> Result<Next, RunError> {
        if let Some(steps) = &mut self.steps {
            let (next, waited) = steps.wait(event, self.bus, &mut self.reporter)?;
            if next == Next::Stop {
                return Ok(next);
            }
            if waited {
                self.pace.resume();
            }
        }
        let greet = || Ok(self.outputs.greet()?);
        self.pace.wait(event, self.outputs.next_seq, self.bus, &mut self.reporter, &greet)
    }

    fn count(&mut self) {
        let counted = self.source.counters();
        self.reporter.counters = Counters { degraded: counted.degraded + self.incomplete, ..counted };
    }

    fn scan(&mut self, header: ScanHeader) -> Result<(), RunError> {
        self.reporter.begin();
        self.incomplete += u64::from(header.lost_packets > 0);
        self.count();
        if let Some(truth) = self.source.truth() {
            self.outputs.truth(truth)?;
        }
        let complete_ns = now_ns();
        let header = self.outputs.scan(header, |index| self.source.point(index))?;
        self.reporter.done(&header.frame, complete_ns);
        self.steps.iter_mut().for_each(|steps| steps.scan_went(&header));
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

    fn greet(&self) -> Result<(), PortError> {
        self.scans.greet()?;
        self.imu.greet()?;
        self.truth.greet()
    }

    /// Counts what an instance before this one has published. Samples between its last scan and the first of this one may be published
    /// twice, with the same number: nobody knows how many of them it got to.
    fn pass_over(&mut self, event: &SensorEvent) {
        match event {
            SensorEvent::Imu(_) => self.next_imu_seq += 1,
            SensorEvent::Scan(_) => self.next_seq += 1,
        }
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

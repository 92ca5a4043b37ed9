//! `evac experiment soak`: an hour's walk through the real processes, and whether time and memory stay what they are.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

use evac_config::{Mode, Pipeline};
use evac_frames::{Ack, Health, PoseFrame, frame_flags};
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::Isometry3;
use evac_ports::services::{OdometryPose, ScanDeskewed, SinkAck, TruthPose};
use evac_ports::{Bus, Domain, FrameSubscriber, PortError, RecordPublisher, RecordSubscriber};
use evac_stage::start_logging;
use indicatif::ProgressBar;
use toml::Value;

use super::cli::SoakArgs;
use super::process::ProcessFigures;
use super::soak_report::{Minute, Soak};
use crate::check::check;
use crate::error::LaunchError;
use crate::finite::{create_folder, set, write_pipeline};
use crate::progress::bar;
use crate::supervisor::{Supervisor, interrupted};

const SOAK: &str = include_str!("../pipelines/soak.toml");
/// The launcher's part in the pipeline file.
const SINK: &str = "soak";
/// Name of the odometry's stage.
const ODOMETRY: &str = "lio";
/// Frames of a simulated minute.
const MINUTE: usize = 600;

pub(super) fn soak(args: &SoakArgs) -> Result<(), LaunchError> {
    start_logging(&args.log);
    create_folder(&args.output)?;
    let pipeline = pipeline(args)?;
    let file = args.output.join("pipeline.toml");
    write_pipeline(&file, &pipeline)?;
    let own = format!("soak-{}", std::process::id());
    let domain = Domain::new(args.domain.as_deref().unwrap_or(&own))?;
    let minutes = walk(args, &pipeline, &file, &domain)?;
    let soak = Soak::of(args.world.name(), args.seed, minutes);
    println!("\n{}", soak.verdict());
    for path in soak.write(&args.output)? {
        println!("{}", path.display());
    }
    Ok(())
}

/// The pipeline that the stages read.
fn pipeline(args: &SoakArgs) -> Result<Pipeline, LaunchError> {
    let mut pipeline = Pipeline::parse(Path::new("soak.toml"), SOAK)?;
    pipeline.mode = Mode::Lossless;
    let seed = i64::try_from(args.seed)
        .map_err(|_| super::usage(format!("--seed {} is too large; use at most {}", args.seed, i64::MAX)))?;
    set(&mut pipeline, "simulator", "world", Value::from(args.world.name()));
    set(&mut pipeline, "simulator", "seed", Value::from(seed));
    // A lap takes longer than a minute.
    set(&mut pipeline, "simulator", "laps", Value::from(i64::from(args.minutes) + 1));
    set(&mut pipeline, "simulator", "duration_s", Value::from(f64::from(args.minutes) * 60.0));
    Ok(pipeline)
}

fn walk(
    args: &SoakArgs,
    pipeline: &Pipeline,
    file: &Path,
    domain: &Domain,
) -> Result<Vec<Minute>, LaunchError> {
    // All but the launcher itself.
    let mut started = pipeline.clone();
    started.stages.retain(|stage| stage.name() != SINK);
    check(&started).map_err(super::usage)?;
    let (mut supervisor, mut wakeups) = Supervisor::start(&started, file, domain, &args.log)?;
    let mut monitor = Monitor::open(&supervisor.bus)?;
    wakeups.listeners.append(&mut monitor.listeners);
    let bar = bar(u64::from(args.minutes) * MINUTE as u64, "frames");
    println!("{}", Minute::head());
    let ended = wakeups.wait(|_| match step(&mut supervisor, &mut monitor, &bar) {
        Ok(false) if supervisor.bus.stop_requested() => ControlFlow::Break(Err(interrupted())),
        Ok(false) => ControlFlow::Continue(Duration::from_millis(500)),
        Ok(true) => ControlFlow::Break(Ok(())),
        Err(error) => ControlFlow::Break(Err(error)),
    })?;
    bar.finish_and_clear();
    let stopped = supervisor.stop();
    ended.and(stopped)?;
    Ok(monitor.minutes)
}

/// Takes in what has come; whether the walk has ended.
fn step(supervisor: &mut Supervisor, monitor: &mut Monitor, bar: &ProgressBar) -> Result<bool, LaunchError> {
    supervisor.watch()?;
    let pid = supervisor.board().get(ODOMETRY).map_or(0, |health| health.pid);
    monitor.take_in(pid, bar)
}

/// The sink: measures every pose and acknowledges it.
struct Monitor {
    scans: FrameSubscriber<ScanDeskewed>,
    poses: RecordSubscriber<OdometryPose>,
    truths: RecordSubscriber<TruthPose>,
    acks: RecordPublisher<SinkAck>,
    listeners: Vec<evac_ports::Listener>,
    /// Hand-over times of scans whose pose has not come, by `seq`.
    handed: VecDeque<(u64, i64)>,
    /// True poses of scans whose pose has not come, by `seq`.
    truth: VecDeque<(u64, Isometry3<f64>)>,
    /// The first pose beside its truth.
    first: Option<(Isometry3<f64>, Isometry3<f64>)>,
    /// Milliseconds of this minute's frames.
    times: Vec<f64>,
    cpu_s: f64,
    minutes: Vec<Minute>,
}

impl Monitor {
    fn open(bus: &Bus) -> Result<Self, PortError> {
        let (scans, scan_listener) = FrameSubscriber::open(bus)?;
        let (poses, pose_listener) = RecordSubscriber::open(bus)?;
        let (truths, truth_listener) = RecordSubscriber::open(bus)?;
        Ok(Self {
            scans,
            poses,
            truths,
            acks: RecordPublisher::open(bus)?,
            listeners: vec![scan_listener, pose_listener, truth_listener],
            handed: VecDeque::new(),
            truth: VecDeque::new(),
            first: None,
            times: Vec::with_capacity(MINUTE),
            cpu_s: 0.0,
            minutes: Vec::new(),
        })
    }

    fn take_in(&mut self, pid: u32, bar: &ProgressBar) -> Result<bool, LaunchError> {
        while let Some(scan) = self.scans.receive()? {
            self.handed.push_back((scan.header().frame.seq, scan.header().frame.sent_ns));
        }
        while let Some(truth) = self.truths.receive()? {
            self.truth.push_back((truth.frame.seq, map_from_lidar(&truth)));
        }
        while let Some(pose) = self.poses.receive()? {
            let ended = self.pose(&pose, pid, bar)?;
            bar.set_position(pose.frame.seq + 1);
            let ack =
                Ack { name: Health::text(SINK), seq: pose.frame.seq, finished: u32::from(ended), epoch: 0 };
            self.acks.publish(&ack)?;
            if ended {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Whether it was the last.
    fn pose(&mut self, pose: &PoseFrame, pid: u32, bar: &ProgressBar) -> Result<bool, LaunchError> {
        let seq = pose.frame.seq;
        if let Some(sent_ns) = at(&mut self.handed, seq) {
            self.times.push(pose.frame.sent_ns.saturating_sub(sent_ns) as f64 * 1e-6);
        }
        let here = map_from_lidar(pose);
        let truth = at(&mut self.truth, seq);
        if let Some(truth) = truth {
            self.first.get_or_insert((here, truth));
        }
        let ended = pose.frame.flags & frame_flags::END_OF_STREAM != 0;
        let whole = (seq + 1).is_multiple_of(MINUTE as u64);
        if whole {
            let drift_m = self.first.zip(truth).map_or(f64::NAN, |((pose0, truth0), truth)| {
                let (estimated, truly) = (pose0.inverse() * here, truth0.inverse() * truth);
                (estimated.translation.vector - truly.translation.vector).norm()
            });
            let process = ProcessFigures::of(pid)?;
            let cpu_ms = (process.cpu_s - self.cpu_s) * 1e3 / self.times.len().max(1) as f64;
            self.cpu_s = process.cpu_s;
            let minute =
                Minute::new(self.minutes.len() + 1, &mut self.times, cpu_ms, &process, drift_m, pose.state);
            bar.suspend(|| println!("{}", minute.line()));
            self.minutes.push(minute);
            self.times.clear();
        }
        Ok(ended)
    }
}

/// The value of `seq`; it and all before it are taken out.
fn at<T>(waiting: &mut VecDeque<(u64, T)>, seq: u64) -> Option<T> {
    while let Some((number, value)) = waiting.pop_front() {
        if number == seq {
            return Some(value);
        }
        if number > seq {
            waiting.push_front((number, value));
            break;
        }
    }
    None
}

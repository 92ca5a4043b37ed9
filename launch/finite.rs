//! `evac demo` and `evac map`: a walk with an end, from its first frame to the summary.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use evac_config::{Mode, Pipeline, Rig, RigFile};
use evac_formats::write_atomically;
use evac_ports::Domain;
use evac_stage::start_logging;
use toml::Value;

use crate::check::check;
use crate::cli::{DemoArgs, MapArgs, Odometry, OdometryArgs, RecordingArgs};
use crate::error::LaunchError;
use crate::progress::Bar;
use crate::registry::ODOMETRIES;
use crate::summary::{self, Run};
use crate::supervisor::{Progress, Supervisor, interrupted};
use crate::{cpu, devices};

const DEMO: &str = include_str!("pipelines/demo.toml");
const MAP: &str = include_str!("pipelines/map.toml");

/// `evac demo`.
pub(crate) fn demo(args: &DemoArgs) -> Result<(), LaunchError> {
    start_logging(&args.log);
    let with_devices = args.devices.devices;
    let mut pipeline = match with_devices {
        true => devices::pipeline(&args.output, &args.devices)?,
        false => Pipeline::parse(Path::new("demo.toml"), DEMO)?,
    };
    if args.real_time {
        pipeline.mode = Mode::Live;
    }
    choose(&mut pipeline, &args.odometry);
    let world = Value::try_from(args.world)
        .map_err(|cause| LaunchError::Path(format!("--world {:?}: {cause}", args.world)))?;
    let about = format!("simulated {}, seed {}", world.as_str().unwrap_or_default(), args.seed);
    let mut set_walk = |key: &str, value: Value| match with_devices {
        true => devices::set_walk(&mut pipeline, key, value),
        false => set(&mut pipeline, "simulator", key, value),
    };
    set_walk("world", world);
    for (key, value) in [("seed", args.seed), ("building", args.building)] {
        let number = i64::try_from(value).map_err(|_| {
            LaunchError::Path(format!("--{key} {value} is too large; use at most {}", i64::MAX))
        })?;
        set_walk(key, Value::from(number));
    }
    if let Some(duration) = args.duration {
        set_walk("duration_s", Value::from(duration));
    }
    if let Some(folder) = &args.record {
        create_folder(folder)?;
        set_walk("record", path_value(folder)?);
    }
    let ends_with = with_devices.then_some(devices::SIMULATOR);
    let run = Run { command: "demo", output: &args.output, truth: None, about, ends_with };
    run_to_the_end(pipeline, &Domain::new(&args.domain)?, args.resolution, &args.log, &run)
}

/// `evac map`.
pub(crate) fn map(args: &MapArgs) -> Result<(), LaunchError> {
    start_logging(&args.log);
    let mut pipeline = Pipeline::parse(Path::new("map.toml"), MAP)?;
    pipeline.rig = args.recording.rig()?;
    choose(&mut pipeline, &args.odometry);
    let part = [("start_s", Value::from(args.start)), ("duration_s", Value::from(args.duration))];
    for (key, value) in keys_of(&args.recording)?.into_iter().chain(part) {
        set(&mut pipeline, "replay", key, value);
    }
    if let Some(truth) = &args.truth {
        existing(truth)?;
    }
    if let Some(rate) = args.rate {
        (pipeline.mode, pipeline.rate) = (Mode::Live, Some(rate));
    }
    pipeline.step = args.step;
    let own = format!("map-{}", std::process::id());
    let domain = Domain::new(args.domain.as_deref().unwrap_or(&own))?;
    let run = Run {
        command: "map",
        output: &args.output,
        truth: args.truth.as_deref(),
        about: args.recording.name(),
        ends_with: None,
    };
    run_to_the_end(pipeline, &domain, args.resolution, &args.log, &run)
}

/// The replay's keys for a recording, whose files are there.
pub(crate) fn keys_of(recording: &RecordingArgs) -> Result<Vec<(&'static str, Value)>, LaunchError> {
    let mut keys = vec![("allow_truncated", Value::from(recording.allow_truncated))];
    match (&recording.bag, &recording.lidar) {
        (Some(bag), _) => keys.push(("bag", existing_bag(bag)?)),
        (None, Some(lidar)) => {
            keys.push(("lidar", existing(lidar)?));
            if let Some(imu) = &recording.imu {
                keys.push(("imu", existing(imu)?));
            }
            keys.push(("imu_rate_hz", Value::from(recording.imu_rate)));
            keys.push(("imu_offset_ms", Value::from(recording.imu_offset_ms)));
        }
        (None, None) => {
            return Err(LaunchError::Path("name a recording: WALK.bag or --lidar X.pcap".to_owned()));
        }
    }
    Ok(keys)
}

impl RecordingArgs {
    /// Where the sensors sit.
    pub(crate) fn rig(&self) -> Result<Rig, LaunchError> {
        Ok(self.rig.as_deref().map_or(Ok(Rig::default()), RigFile::read)?)
    }

    /// For people.
    pub(crate) fn name(&self) -> String {
        self.bag.as_ref().or(self.lidar.as_ref()).map_or(String::new(), |path| path.display().to_string())
    }
}

fn run_to_the_end(
    mut pipeline: Pipeline,
    domain: &Domain,
    resolution: Option<f64>,
    log: &evac_stage::LogOptions,
    run: &Run<'_>,
) -> Result<(), LaunchError> {
    create_folder(run.output)?;
    for sink in ["grid_exporter", "map_saver"] {
        set(&mut pipeline, sink, "output_dir", path_value(run.output)?);
    }
    if let Some(resolution) = resolution {
        set(&mut pipeline, "octree_mapper", "resolution_m", Value::from(resolution));
    }
    check(&pipeline).map_err(|cause| LaunchError::Run(evac_stage::RunError::Value(cause)))?;
    // Written where the results are, so that the run can be repeated with `evac up`.
    let file = run.output.join("pipeline.toml");
    write_pipeline(&file, &pipeline)?;

    let started = Instant::now();
    let (mut supervisor, wakeups) = Supervisor::start(&pipeline, &file, domain, log)?;
    // Each step says itself what has gone.
    let bar = (!pipeline.step).then(|| Bar::new(&run.about));
    let mut frames = 0;
    let mut end = devices::End::of(run.ends_with);
    let ended = wakeups.wait(|_| match step(&mut supervisor, bar.as_ref(), &mut frames) {
        Ok(Progress::Running) if supervisor.bus.stop_requested() => ControlFlow::Break(Err(interrupted())),
        Ok(Progress::Running) if end.has_come(supervisor.board()) => ControlFlow::Break(Ok(())),
        Ok(Progress::Running) => ControlFlow::Continue(Duration::from_millis(100)),
        Ok(Progress::Finished) => ControlFlow::Break(Ok(())),
        Err(error) => ControlFlow::Break(Err(error)),
    })?;
    if let Some(bar) = &bar {
        bar.end();
    }
    let cpu = cpu::shares(supervisor.board());
    let stopped = supervisor.stop();
    ended.and(stopped)?;
    summary::write(run, &pipeline, supervisor.board(), &cpu, started.elapsed())
}

fn step(supervisor: &mut Supervisor, bar: Option<&Bar>, frames: &mut u64) -> Result<Progress, LaunchError> {
    let progress = supervisor.watch()?;
    while let Some(ack) = supervisor.take_ack()? {
        *frames = (*frames).max(ack.seq + 1);
    }
    if let Some(bar) = bar {
        bar.show(*frames, supervisor.total_scans());
    }
    Ok(progress)
}

/// Puts the chosen odometry in the place of the pipeline's own.
fn choose(pipeline: &mut Pipeline, args: &OdometryArgs) {
    let chosen = match args.odometry {
        Odometry::Lio => ODOMETRIES[0],
        Odometry::Loam => ODOMETRIES[1],
    };
    for entry in pipeline.stages.iter_mut().filter(|entry| ODOMETRIES.contains(&entry.kind.as_str())) {
        chosen.clone_into(&mut entry.kind);
    }
    if args.no_deskewing {
        set(pipeline, "deskewer", "enabled", Value::from(false));
    }
}

/// Sets a key of every stage of a kind.
pub(crate) fn set(pipeline: &mut Pipeline, stage: &str, key: &str, value: Value) {
    for entry in pipeline.stages.iter_mut().filter(|entry| entry.kind == stage) {
        entry.config.insert(key.to_owned(), value.clone());
    }
}

/// Writes a pipeline file, whole or not at all.
pub(crate) fn write_pipeline(file: &Path, pipeline: &Pipeline) -> Result<(), LaunchError> {
    let text = pipeline_text(pipeline)?;
    Ok(write_atomically(file, |writer| std::io::Write::write_all(writer, text.as_bytes()))?)
}

pub(crate) fn pipeline_text(pipeline: &Pipeline) -> Result<String, LaunchError> {
    toml::to_string(pipeline)
        .map_err(|cause| LaunchError::Path(format!("the pipeline cannot be written: {cause}")))
}

pub(crate) fn create_folder(folder: &Path) -> Result<(), LaunchError> {
    std::fs::create_dir_all(folder).map_err(|cause| {
        LaunchError::Path(format!(
            "{}: {cause}; choose a folder that you may write to with -o",
            folder.display()
        ))
    })
}

/// The path of a file that is there, absolute because stages may run elsewhere.
fn existing(path: &PathBuf) -> Result<Value, LaunchError> {
    match std::fs::metadata(path) {
        Ok(file) if file.is_file() => path_value(path),
        Ok(_) => {
            Err(LaunchError::Path(format!("{}: is not a file; name the recording itself", path.display())))
        }
        Err(cause) => Err(LaunchError::Path(format!("{}: {cause}; check the path", path.display()))),
    }
}

/// The path of a bag, which may be a folder of files.
fn existing_bag(path: &PathBuf) -> Result<Value, LaunchError> {
    if path.is_dir() { path_value(path) } else { existing(path) }
}

pub(crate) fn path_value(path: &Path) -> Result<Value, LaunchError> {
    let absolute = std::path::absolute(path)
        .map_err(|cause| LaunchError::Path(format!("{}: {cause}; check the path", path.display())))?;
    match absolute.to_str() {
        Some(text) => Ok(Value::from(text)),
        None => Err(LaunchError::Path(format!("{}: the name is not UTF-8; rename it", path.display()))),
    }
}

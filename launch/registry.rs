//! Every kind of stage in this executable.

use evac_config::StageEntry;
use evac_deskewer::Deskewer;
use evac_grid_exporter::GridExporter;
use evac_imu::Imu;
use evac_lidar::Lidar;
use evac_map_saver::MapSaver;
use evac_octree_mapper::OctreeMapper;
use evac_odometry::{Lio, Loam};
use evac_recorder::Recorder;
use evac_replay::Replay;
use evac_simulator::Simulator;
use evac_simulator::devices::DeviceSimulator;
use evac_stage::joins::{
    DeskewedScanWithImu, Join, PlanJoin, RawScanWithImu, ScanPoseJoin, SinkJoin, TapJoin,
};
use evac_stage::{
    Device, RunError, RunOptions, Source, Stage, StageConfig, StageOutput, run_device, run_source,
    run_stage as run_one, say_failure, start_logging,
};

use crate::cli::StageArgs;
use crate::error::LaunchError;

/// When a stage is started and stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Role {
    /// Stopped first, started last.
    Producer,
    Processor,
    /// Stopped last: it finishes its files.
    Consumer,
}

/// What is known about a kind of stage before it is started.
pub(crate) struct Kind {
    pub(crate) name: &'static str,
    pub(crate) role: Role,
    /// Services it reads.
    pub(crate) reads: &'static [&'static str],
    /// Services it writes.
    pub(crate) writes: &'static [&'static str],
    /// Those of them that it writes as it is configured.
    pub(crate) writes_as: fn(&StageEntry) -> &'static [&'static str],
    /// Checks its configuration.
    pub(crate) check: fn(&StageEntry) -> Result<(), String>,
    run: fn(&RunOptions) -> Result<(), RunError>,
}

/// Kinds of which a pipeline has one: they say where the LiDAR is.
pub(crate) const ODOMETRIES: [&str; 2] = [Lio::NAME, Loam::NAME];

/// What a source writes, whichever.
const SOURCE_SERVICES: &[&str] = &["lidar/scan", "imu/sample", "truth/pose"];
/// Kinds that know their whole stream: rate and step are theirs.
pub(crate) const SOURCES: [&str; 2] = [Simulator::NAME, Replay::NAME];

/// All kinds, in the order in which data flows.
pub(crate) fn kinds() -> [Kind; 12] {
    [
        source::<Simulator>(),
        source::<Replay>(),
        device::<DeviceSimulator>(),
        device::<Lidar>(),
        device::<Imu>(),
        stage::<Deskewer, RawScanWithImu>(Role::Processor),
        stage::<Lio, DeskewedScanWithImu>(Role::Processor),
        stage::<Loam, DeskewedScanWithImu>(Role::Processor),
        stage::<OctreeMapper, ScanPoseJoin>(Role::Processor),
        stage::<GridExporter, PlanJoin>(Role::Consumer),
        stage::<MapSaver, SinkJoin>(Role::Consumer),
        stage::<Recorder, TapJoin>(Role::Consumer),
    ]
}

/// The kind of that name.
pub(crate) fn kind(name: &str) -> Result<Kind, RunError> {
    kinds().into_iter().find(|kind| kind.name == name).ok_or_else(|| {
        let names: Vec<_> = kinds().iter().map(|kind| kind.name).collect();
        RunError::Value(format!("there is no stage of kind '{name}'; the kinds are: {}", names.join(", ")))
    })
}

/// `evac stage NAME`.
pub(crate) fn run_stage(args: &StageArgs) -> Result<(), LaunchError> {
    start_logging(&args.options.log);
    let kind = kind(&args.kind)?;
    // The stage's own name in front of its message, as its own executable would write it.
    (kind.run)(&args.options).map_err(|error| {
        say_failure(args.options.name.as_deref().unwrap_or(kind.name), &error);
        LaunchError::Child { name: kind.name.to_owned(), code: error.code() }
    })
}

fn stage<S, J>(role: Role) -> Kind
where
    J: Join,
    S: for<'a> Stage<Input<'a> = J::Frame<'a>>,
{
    Kind {
        name: S::NAME,
        role,
        reads: J::SERVICES,
        writes: S::Output::SERVICES,
        writes_as: |_| S::Output::SERVICES,
        check: check::<S::Config>,
        run: run_one::<S, J>,
    }
}

fn source<S: Source>() -> Kind {
    Kind {
        name: S::NAME,
        role: Role::Producer,
        reads: &[],
        writes: SOURCE_SERVICES,
        writes_as: |_| SOURCE_SERVICES,
        check: check::<S::Config>,
        run: run_source::<S>,
    }
}

fn device<D: Device>() -> Kind {
    Kind {
        name: D::NAME,
        role: Role::Producer,
        reads: &[],
        writes: D::Output::SERVICES,
        writes_as: |entry| entry.typed_config().map_or(D::Output::SERVICES, |config| D::services(&config)),
        check: check::<D::Config>,
        run: run_device::<D>,
    }
}

fn check<C: StageConfig>(entry: &StageEntry) -> Result<(), String> {
    let config: C = entry.typed_config()?;
    config.check().map_err(|cause| format!("stage '{}': {cause}", entry.name()))
}

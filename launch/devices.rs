//! `evac demo --devices`: a simulated walk through real drivers.

use std::path::Path;
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use evac_config::Pipeline;
use evac_simulator::devices::{FAULTS_HELP, Fault};
use toml::{Table, Value};

use crate::error::LaunchError;
use crate::finite::{create_folder, path_value, set};
use crate::health_board::HealthBoard;

/// The stage that plays the devices.
pub(crate) const SIMULATOR: &str = "device_simulator";
const DEVICES: &str = include_str!("pipelines/devices.toml");
/// After the last frame's report: what is under way goes through the pipeline.
const LAST_WAY: Duration = Duration::from_secs(2);

/// Which devices are simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Model {
    /// First wire protocol, with a WT901C
    Mid40,
    /// First wire protocol, with the LiDAR's own IMU and no other
    Avia,
    /// Second wire protocol, with the LiDAR's own IMU and no other
    Mid360,
}

/// What the devices are, and what goes wrong with them.
#[derive(Debug, Args)]
pub(crate) struct DevicesArgs {
    /// Run in real time through the real drivers: a simulated Livox LiDAR on UDP and a WT901C on a pseudo-terminal
    #[arg(long, conflicts_with = "record")]
    pub(crate) devices: bool,
    /// The LiDAR, by its packets; its shots are always a Mid-40's
    #[arg(long, value_enum, requires = "devices", default_value_t = Model::Mid40)]
    lidar: Model,
    #[arg(long = "fault", value_name = "FAULT", requires = "devices", help = fault_help())]
    faults: Vec<Fault>,
}

fn fault_help() -> String {
    format!("Something that goes wrong, and when; may be given several times: {FAULTS_HELP}")
}

/// The pipeline, with addresses that no other demo on this machine uses and the IMU's port in the folder of results.
pub(crate) fn pipeline(output: &Path, args: &DevicesArgs) -> Result<Pipeline, LaunchError> {
    let mut pipeline = Pipeline::parse(Path::new("devices.toml"), DEVICES)?;
    create_folder(output)?;
    let port = path_value(&output.join("wt901c"))?;
    set(&mut pipeline, SIMULATOR, "imu_port", port.clone());
    set(&mut pipeline, "imu", "port", port);
    // Two of the loopback's addresses for each process.
    let [_, a, b, c] = (std::process::id() << 1).to_be_bytes();
    let (host, device) = (format!("127.{}.{b}.{c}", a | 0x40), format!("127.{}.{b}.{}", a | 0x40, c | 1));
    set(&mut pipeline, "lidar", "interface", Value::from(host.clone()));
    for (key, address) in [("broadcast_to", host), ("address", device.clone())] {
        set_in(&mut pipeline, "lidar", key, Value::from(address));
    }
    let faults: Vec<_> = args.faults.iter().map(Fault::to_string).collect();
    set(&mut pipeline, SIMULATOR, "faults", Value::from(faults));
    if args.lidar != Model::Mid40 {
        set_in(&mut pipeline, "lidar", "imu", Value::from(true));
        set(&mut pipeline, "lidar", "publish_imu", Value::from(true));
        pipeline.stages.retain(|entry| entry.kind != "imu");
    }
    if args.lidar == Model::Mid360 {
        set_in(&mut pipeline, "lidar", "protocol", Value::from("sdk2"));
        set(&mut pipeline, "lidar", "protocol", Value::from("sdk2"));
        // There are no broadcasts on the loopback interface that would find it.
        set(&mut pipeline, "lidar", "device", Value::from(device));
    }
    Ok(pipeline)
}

/// Sets a key of the walk.
pub(crate) fn set_walk(pipeline: &mut Pipeline, key: &str, value: Value) {
    set_in(pipeline, "walk", key, value);
}

/// Sets a key of a table of the simulator.
fn set_in(pipeline: &mut Pipeline, table: &str, key: &str, value: Value) {
    for entry in pipeline.stages.iter_mut().filter(|entry| entry.kind == SIMULATOR) {
        let inner = entry.config.entry(table).or_insert_with(|| Value::Table(Table::new()));
        if let Some(inner) = inner.as_table_mut() {
            inner.insert(key.to_owned(), value.clone());
        }
    }
}

/// The end of a run whose sinks are not told that the stream has ended.
#[derive(Debug)]
pub(crate) struct End {
    stage: Option<&'static str>,
    seen: Option<Instant>,
}

impl End {
    /// Of a run that ends with the last frame of a stage, if of any.
    pub(crate) fn of(stage: Option<&'static str>) -> Self {
        Self { stage, seen: None }
    }

    /// Whether the stage has put out all its frames, and they have had time to go through.
    pub(crate) fn has_come(&mut self, board: &HealthBoard) -> bool {
        let health = self.stage.and_then(|stage| board.get(stage));
        let is_through = health.is_some_and(|health| health.total > 0 && health.frames_out >= health.total);
        is_through && self.seen.get_or_insert_with(Instant::now).elapsed() >= LAST_WAY
    }
}

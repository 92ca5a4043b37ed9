//! `evac demo --devices`: a simulated walk through real drivers.

use std::path::Path;
use std::time::{Duration, Instant};

use evac_config::Pipeline;
use toml::{Table, Value};

use crate::error::LaunchError;
use crate::finite::{create_folder, path_value, set};
use crate::health_board::HealthBoard;

/// The stage that plays the devices.
pub(crate) const SIMULATOR: &str = "device_simulator";
const DEVICES: &str = include_str!("pipelines/devices.toml");
/// After the last frame's report: what is under way goes through the pipeline.
const LAST_WAY: Duration = Duration::from_secs(2);

/// The pipeline, with addresses that no other demo on this machine uses and the IMU's port in the folder of results.
pub(crate) fn pipeline(output: &Path) -> Result<Pipeline, LaunchError> {
    let mut pipeline = Pipeline::parse(Path::new("devices.toml"), DEVICES)?;
    create_folder(output)?;
    let port = path_value(&output.join("wt901c"))?;
    set(&mut pipeline, SIMULATOR, "imu_port", port.clone());
    set(&mut pipeline, "imu", "port", port);
    // Two of the loopback's addresses for each process.
    let [_, a, b, c] = (std::process::id() << 1).to_be_bytes();
    let (host, device) = (format!("127.{}.{b}.{c}", a | 0x40), format!("127.{}.{b}.{}", a | 0x40, c | 1));
    set(&mut pipeline, "lidar", "interface", Value::from(host.clone()));
    for (key, address) in [("broadcast_to", host), ("address", device)] {
        set_in(&mut pipeline, "lidar", key, Value::from(address));
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

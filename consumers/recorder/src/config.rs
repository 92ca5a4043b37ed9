//! Configuration of the recorder.

use std::path::PathBuf;

use evac_formats::mcap::Packing;
use evac_stage::{StageConfig, check_range};
use serde::{Deserialize, Serialize};

use crate::channels::SERVICES;

/// Where a recording goes and what is in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RecorderConfig {
    /// Folder of all recordings; it is created.
    pub output_dir: PathBuf,
    /// Name of this recording, a folder of its own that must not hold one yet; the date and time in UTC where it is not set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Services that are recorded. `["lidar/scan", "imu/sample"]` is all that a replay needs, 3.5 MB/s of a Mid-40 with
    /// both forms below and half of it without `ros`.
    pub services: Vec<String>,
    /// Record ROS 2 messages, for Foxglove, Rerun, `ros2 bag` and Python.
    pub ros: bool,
    /// Record frames as they lie in shared memory (topics `/evac/...`), for exact replay.
    pub raw: bool,
    /// How chunks are packed: `none`, or `lz4` where the disk is small and a core is idle.
    pub compression: Compression,
    /// Size of a chunk, MiB. A power cut loses at most the chunk that is being filled.
    pub chunk_mib: u32,
    /// Longest time that a chunk is filled, seconds of sensor time.
    pub chunk_s: f64,
    /// Size at which the next file is begun, MiB; 0 never.
    pub max_file_mib: u32,
    /// Sensor time after which the next file is begun, seconds; 0 never.
    pub max_file_s: f64,
    /// Chunks that may wait for the disk. When there are more the recorder waits, and what it then misses in shared memory is
    /// counted as lost; nobody waits for it but a lossless replay.
    pub queue_chunks: u32,
}

/// How chunks are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Compression {
    /// As they are.
    None,
    /// LZ4, in pure Rust.
    Lz4,
}

impl From<Compression> for Packing {
    fn from(compression: Compression) -> Self {
        match compression {
            Compression::None => Self::None,
            Compression::Lz4 => Self::Lz4,
        }
    }
}

impl Default for RecorderConfig {
    fn default() -> Self {
        Self {
            output_dir: PathBuf::from("recordings"),
            name: None,
            services: SERVICES.iter().map(|service| (*service).to_owned()).collect(),
            ros: true,
            raw: true,
            compression: Compression::None,
            chunk_mib: 4,
            chunk_s: 1.0,
            max_file_mib: 4096,
            max_file_s: 0.0,
            queue_chunks: 16,
        }
    }
}

impl StageConfig for RecorderConfig {
    fn check(&self) -> Result<(), String> {
        if let Some(unknown) = self.services.iter().find(|name| !SERVICES.contains(&name.as_str())) {
            return Err(format!("services: there is no '{unknown}'; there are: {}", SERVICES.join(", ")));
        }
        if self.services.is_empty() || !(self.ros || self.raw) {
            return Err("nothing would be recorded: name services, and set ros or raw".to_owned());
        }
        let odd = |name: &&String| name.is_empty() || name.starts_with('.') || name.contains('/');
        if let Some(name) = self.name.as_ref().filter(odd) {
            return Err(format!("name = \"{name}\" must be a plain folder name"));
        }
        let day = 86_400.0;
        check_range("chunk_mib", f64::from(self.chunk_mib), 1.0, 256.0, "4 is a second of everything")?;
        check_range("chunk_s", self.chunk_s, 0.01, 60.0, "a power cut loses this much")?;
        check_range("max_file_mib", f64::from(self.max_file_mib), 0.0, 4e6, "0 never begins another file")?;
        check_range("max_file_s", self.max_file_s, 0.0, day, "0 never begins another file")?;
        check_range("queue_chunks", f64::from(self.queue_chunks), 1.0, 1024.0, "16 bridge some seconds")
    }
}

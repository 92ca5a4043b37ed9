//! What a stage is, and everything it does not have to care about.
//!
//! A stage crate implements [`Stage`] (processors and consumers) or [`Source`] (producers) as a pure function over the
//! types in this crate; a driver implements [`Device`]. Its `main.rs` wires it to services with [`stage_main`], [`source_main`] or
//! [`device_main`]:
//!
//! ```ignore
//! fn main() -> std::process::ExitCode {
//!     evac_stage::stage_main::<Deskewer, evac_stage::joins::RawScanWithImu>(std::env::args_os())
//! }
//! ```
//!
//! The run loop adds ports, wake-up, the joining of streams, SIGTERM, health with latency histograms, acknowledgement in
//! lossless mode, `--config`, `--print-config`, `--check` and exit codes.

mod ack;
mod check;
mod checkpoint;
mod device;
mod exit;
mod follow;
mod gate;
mod health;
mod input;
pub mod joins;
mod lidar_output;
mod logging;
mod options;
mod output;
mod pace;
mod role;
mod run_device;
mod run_source;
mod run_stage;
mod source;
mod stage;
mod stage_main;
mod step;
mod tracer;
mod tracking;

pub use check::check_range;
pub use checkpoint::State;
pub use device::Device;
pub use evac_config::Rig;
pub use exit::{RunError, exit_code};
pub use follow::{Followed, Follower, Readiness, Routed};
pub use health::{InputCounters, Reporter};
pub use input::{MapMessage, PlanInput, ScanWithImu, ScanWithPose, SinkInput, Tapped};
pub use lidar_output::LidarOutput;
pub use logging::{Format as LogFormat, LogOptions, say_failure, start_logging};
pub use options::RunOptions;
pub use output::{
    GridOutput, ImuOutput, MapOutput, NoOutput, PoseOutput, RawScanOutput, ScanOutput, StageOutput,
    TruthOutput,
};
pub use run_device::{device_main, run_device};
pub use run_source::{run_source, source_main};
pub use run_stage::run_stage;
pub use source::{SensorEvent, Source};
pub use stage::{Counters, Stage, StageConfig, StageError};
pub use stage_main::stage_main;

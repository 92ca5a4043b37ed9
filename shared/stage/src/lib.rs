//! What a stage is, and everything it does not have to care about.
//!
//! A stage crate implements [`Stage`] (processors and consumers) or [`Source`] (producers) as a pure function over the
//! types in this crate; its `main.rs` wires it to services with [`stage_main`] or [`source_main`]:
//!
//! ```ignore
//! fn main() -> std::process::ExitCode {
//!     evac_stage::stage_main::<Deskewer, evac_stage::joins::RawScanWithImu>(std::env::args_os())
//! }
//! ```
//!
//! The run loop adds ports, wake-up, the joining of streams, SIGTERM, health with latency histograms, acknowledgement in
//! lossless mode, `--config`, `--print-config`, `--check` and exit codes.

mod check;
mod exit;
mod health;
mod input;
pub mod joins;
mod logging;
mod options;
mod output;
mod pace;
mod run_source;
mod run_stage;
mod source;
mod stage;
mod tracking;

pub use check::check_range;
pub use evac_config::Rig;
pub use exit::{RunError, exit_code};
pub use health::{InputCounters, Reporter};
pub use input::{MapMessage, PlanInput, ScanWithImu, ScanWithPose, SinkInput, Tapped};
pub use logging::{LogOptions, start_logging};
pub use options::RunOptions;
pub use output::{GridOutput, MapOutput, NoOutput, PoseOutput, ScanOutput, StageOutput};
pub use run_source::{run_source, source_main};
pub use run_stage::{run_stage, stage_main};
pub use source::{SensorEvent, Source};
pub use stage::{Counters, Stage, StageConfig, StageError};

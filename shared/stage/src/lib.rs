//! What a stage is: [`Stage`] for processors and consumers, [`Source`] for producers, and what they read and write.

mod input;
mod output;
mod source;
mod stage;

pub use evac_config::Rig;
pub use input::{MapMessage, PlanInput, ScanWithImu, ScanWithPose, SinkInput};
pub use output::{GridOutput, MapOutput, NoOutput, PoseOutput, ScanOutput};
pub use source::{SensorEvent, Source};
pub use stage::{Counters, Stage, StageConfig, StageError};

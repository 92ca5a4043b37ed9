//! Experiments with the odometry: walks held in memory, faults laid over them, deskewer and odometry run over the
//! result in one process, and the figures of what came out.
//!
//! A [`Walk`] is simulated or read from a recording once; [`Fault::applied`] gives the same walk as a faulty sensor or
//! a wrong rig would have given it, without simulating it again.

mod corners;
mod error;
mod fault;
mod figures;
mod hand_over;
mod honesty;
mod join;
mod loss;
mod recording;
pub mod report;
mod run;
mod schedule;
mod settings;
mod sources;
mod verdict;
mod view;
mod walk;
mod walls;

pub use corners::Corners;
pub use error::ExperimentError;
pub use fault::Fault;
pub use figures::Figures;
pub use hand_over::{HandOver, Moment, hand_overs};
pub use loss::Losses;
pub use recording::{read_recording, read_replay};
pub use run::{FrameResult, Pipeline, Trajectory, run};
pub use schedule::in_threads;
pub use settings::{OdometryKind, Settings};
pub use sources::{Group, Source, catalogue, recorded};
pub use verdict::Verdict;
pub use view::View;
pub use walk::{Frame, Walk, simulated};
pub use walls::{Wall, blank_wall};

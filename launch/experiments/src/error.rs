//! What can go wrong with an experiment itself; an odometry that fails is a result.

use std::path::PathBuf;

use evac_stage::StageError;

/// Why an experiment cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A file of a recording or of the results.
    #[error("{path}: {cause}")]
    File {
        /// The file.
        path: PathBuf,
        /// Cause and remedy.
        cause: String,
    },
    /// The simulator, the replay or a stage refused its configuration.
    #[error("{about}: {cause}")]
    Stage {
        /// Which walk.
        about: String,
        /// What it said.
        cause: StageError,
    },
    /// An option does not fit.
    #[error("{0}")]
    Option(String),
}

impl ExperimentError {
    pub(crate) fn file(path: impl Into<PathBuf>, cause: impl ToString) -> Self {
        Self::File { path: path.into(), cause: cause.to_string() }
    }
}

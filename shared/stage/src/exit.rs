//! Exit codes: 0 done, 1 failed while running, 2 usage, 3 configuration, 4 device or file, 5 incompatible or missing peer.

use std::process::ExitCode;

use evac_config::ConfigError;
use evac_ports::PortError;

use crate::{StageError, say_failure};

/// Why a process ends before its work is done.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A configuration was refused.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A configuration value was refused.
    #[error("{0}")]
    Value(String),
    /// The stage cannot go on.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// Shared memory refused.
    #[error(transparent)]
    Port(#[from] PortError),
    /// A partner that the stage cannot work without is not there.
    #[error("{0}")]
    Peer(String),
}

impl RunError {
    /// The process's exit code.
    pub fn code(&self) -> u8 {
        match self {
            Self::Config(ConfigError::Read { .. }) => 4,
            Self::Config(_) | Self::Value(_) | Self::Stage(StageError::Config(_)) => 3,
            Self::Port(PortError::BadDomain { .. }) => 3,
            Self::Stage(StageError::File(_)) => 4,
            Self::Port(PortError::LayoutMismatch { .. } | PortError::DomainInUse { .. }) | Self::Peer(_) => 5,
            Self::Stage(StageError::Output(_)) | Self::Port(PortError::Refused { .. }) => 1,
        }
    }
}

/// Reports the end of a process on standard error and gives its exit code.
pub fn exit_code(name: &str, result: Result<(), RunError>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say_failure(name, &error);
            ExitCode::from(error.code())
        }
    }
}

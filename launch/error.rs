//! Why the launcher ends before its work is done, and with which exit code.

use evac_config::ConfigError;
use evac_formats::FormatError;
use evac_ports::PortError;
use evac_stage::RunError;

#[derive(Debug, thiserror::Error)]
pub(crate) enum LaunchError {
    #[error(transparent)]
    Run(#[from] RunError),
    #[error(transparent)]
    File(#[from] FormatError),
    /// A file or folder that is not a format's affair.
    #[error("{0}")]
    Path(String),
    /// A stage ended; it has said why itself.
    #[error("stage '{name}' ended with code {code}")]
    Child { name: String, code: u8 },
    /// What the doctor found, which has been printed.
    #[error("{0} of these would stop a run")]
    Unfit(usize),
    /// A stage ended without a word.
    #[error("{0}")]
    Silent(String),
}

impl LaunchError {
    pub(crate) fn code(&self) -> u8 {
        match self {
            Self::Run(error) => error.code(),
            Self::File(_) | Self::Path(_) | Self::Unfit(_) => 4,
            Self::Child { code, .. } => *code,
            Self::Silent(_) => 1,
        }
    }
}

impl From<ConfigError> for LaunchError {
    fn from(error: ConfigError) -> Self {
        Self::Run(error.into())
    }
}

impl From<PortError> for LaunchError {
    fn from(error: PortError) -> Self {
        Self::Run(error.into())
    }
}

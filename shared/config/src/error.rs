//! Why a configuration was refused: which file, where, what, and what to try.

use std::path::{Path, PathBuf};

/// Why a configuration was refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file could not be read.
    #[error("{}: {cause}; check that the path names a text file that may be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's words.
        cause: std::io::Error,
    },
    /// The file is not TOML, or has a key or value that is not allowed.
    #[error("{}: {place}{cause}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// Byte and line, where known.
        place: String,
        /// What is wrong and what is allowed.
        cause: String,
    },
}

impl ConfigError {
    /// The text of a file.
    pub(crate) fn read(path: &Path) -> Result<String, Self> {
        std::fs::read_to_string(path).map_err(|cause| Self::Read { path: path.to_owned(), cause })
    }

    /// An error of the TOML reader, with its place in `text`.
    pub(crate) fn toml(path: &Path, text: &str, cause: &toml::de::Error) -> Self {
        let place = cause.span().map_or(String::new(), |span| {
            let line = text.bytes().take(span.start).filter(|byte| *byte == b'\n').count() + 1;
            format!("line {line} (byte {}): ", span.start)
        });
        Self::Parse { path: path.to_owned(), place, cause: cause.message().replace('\n', " ") }
    }

    /// A value that the types allow but the pipeline cannot work with.
    pub fn value(path: &Path, cause: impl Into<String>) -> Self {
        Self::Parse { path: path.to_owned(), place: String::new(), cause: cause.into() }
    }
}

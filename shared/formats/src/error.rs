//! The one error of all readers: which file, where in it, why, and what to try.

use std::path::{Path, PathBuf};

/// Why a file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// The bytes are not what the format says.
    #[error("{}: byte {offset}: {cause}; {remedy}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Bytes from its start to the place of the fault.
        offset: u64,
        /// What is wrong, with numbers.
        cause: String,
        /// What to try.
        remedy: String,
    },
    /// The operating system refused.
    #[error("{}: {cause}; {remedy}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's words.
        cause: std::io::Error,
        /// What to try.
        remedy: &'static str,
    },
}

impl FormatError {
    /// Bytes that are not what the format says.
    pub fn malformed(path: &Path, offset: u64, cause: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Malformed { path: path.to_owned(), offset, cause: cause.into(), remedy: remedy.into() }
    }

    /// An error of the operating system on opening or reading.
    pub fn reading(path: &Path, cause: std::io::Error) -> Self {
        let remedy = match cause.kind() {
            std::io::ErrorKind::NotFound => "check the path",
            std::io::ErrorKind::PermissionDenied => "check the file's permissions",
            _ => "check the disk and try again",
        };
        Self::Io { path: path.to_owned(), cause, remedy }
    }

    /// An error of the operating system on writing.
    pub fn writing(path: &Path, cause: std::io::Error) -> Self {
        let remedy = match cause.kind() {
            std::io::ErrorKind::NotFound => "create the folder first",
            std::io::ErrorKind::PermissionDenied => "choose a folder that you may write to",
            std::io::ErrorKind::StorageFull => "free some disk space",
            _ => "check the disk and try again",
        };
        Self::Io { path: path.to_owned(), cause, remedy }
    }
}

//! File and wire formats: bytes in, typed values out, and back. No IPC, no clock. No parser panics on any bytes.

mod atomic_file;
mod error;
pub mod octomap;

pub use atomic_file::write_atomically;
pub use error::FormatError;

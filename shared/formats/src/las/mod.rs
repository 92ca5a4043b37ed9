//! ASPRS LAS 1.0 to 1.4, point formats 0 to 10, plain and as LAZ: read only.
//!
//! The header is read here. Of LAZ only the arithmetic decoder is another's (crate `laz`): what the file claims about
//! sizes is checked here first, since that crate believes it.

mod gps_time;
mod header;
mod laz;
mod reader;

pub use header::Header;
pub use reader::Reader;

#[cfg(test)]
mod tests;

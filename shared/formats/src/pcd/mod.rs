//! Point Cloud Data files, version 0.7: read as ascii, binary and binary_compressed, written as ascii and binary.
//!
//! ```no_run
//! # fn main() -> Result<(), evac_formats::FormatError> {
//! for point in evac_formats::pcd::Reader::open("hall.pcd".as_ref())? {
//!     let point = point?;
//!     println!("{} {} {}", point.x, point.y, point.z);
//! }
//! # Ok(())
//! # }
//! ```

mod header;
mod lzf;
mod reader;
mod writer;

pub use header::{Encoding, Field, Header, Scalar};
pub use reader::Reader;
pub use writer::{WriteAs, write, write_to};

#[cfg(test)]
mod tests;

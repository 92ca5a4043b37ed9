//! Polygon files (PLY): the vertices of ascii and binary files of either byte order; written as binary little endian.

mod header;
mod reader;
mod writer;

pub use reader::Reader;
pub use writer::{write, write_to};

#[cfg(test)]
mod tests;

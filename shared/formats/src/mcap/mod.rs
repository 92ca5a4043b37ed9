//! MCAP files (<https://mcap.dev/spec>), the default of ROS 2 bags and what evac records: records of one byte of kind and
//! eight of length; messages lie in chunks, plain or compressed with lz4 or zstd, or between them.

mod index;
mod record;
mod summary;
mod writer;

pub use index::McapIndex;
pub use writer::{BARE_END, McapWriter, Packing};

//! ROS 1 bags, format 2.0: records with named header fields; messages lie in chunks, plain or compressed with bz2 or lz4.

mod index;
mod record;
mod walk;

pub use index::BagIndex;

pub use crate::bag::{BagMessage, BagReader, Connection};

//! What bags of all kinds have in common: connections with topics and types, and messages as they lie in the file.

pub(crate) mod chunk;
mod chunk_reader;
mod db3;
mod file_index;
mod files;

pub use chunk_reader::BagReader;
pub(crate) use chunk_reader::{Found, Record};
pub use file_index::FileIndex;
pub use files::{Bag, Messages};

use std::collections::BTreeMap;

use crate::ros::Encoding;

/// A topic's publisher.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Connection {
    /// Number that messages name it by.
    pub id: u32,
    /// Topic, for example `/livox/lidar`.
    pub topic: String,
    /// Message type, for example `sensor_msgs/Imu` or `sensor_msgs/msg/Imu`.
    pub type_name: String,
    /// How its messages are serialised.
    pub encoding: Encoding,
    /// What the recorder says of it besides, for MCAP.
    pub metadata: BTreeMap<String, String>,
    /// Messages in the whole bag.
    pub messages: u64,
}

/// A message as it lies in the bag.
#[derive(Debug, Clone, Copy)]
pub struct BagMessage<'a> {
    /// Connection, see [`Connection::id`].
    pub connection: u32,
    /// When it was recorded, nanoseconds since 1970. Not when it was measured: that is in the message's header.
    pub time_ns: i64,
    /// Serialised message.
    pub data: &'a [u8],
    /// Where it begins in the file; for a compressed chunk, where the chunk begins.
    pub offset: u64,
}

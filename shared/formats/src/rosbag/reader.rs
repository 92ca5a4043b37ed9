//! The messages of chosen connections, chunk by chunk.

use std::fs::File;
use std::ops::Range;
use std::path::PathBuf;

use super::chunk::{Chunk, Compression};
use super::index::BagIndex;
use super::record::{op, split_record};
use crate::FormatError;

/// A message as it lies in the bag.
#[derive(Debug, Clone, Copy)]
pub struct BagMessage<'a> {
    /// Connection, see [`super::Connection::id`].
    pub connection: u32,
    /// When it was recorded, nanoseconds since 1970. Not when it was measured: that is in the message's header.
    pub time_ns: i64,
    /// Serialised message.
    pub data: &'a [u8],
    /// Where it begins in the file; for a compressed chunk, where the chunk begins.
    pub offset: u64,
}

/// Streams messages in the order in which they were written, which is the order of recording. Memory holds one
/// unpacked chunk; chunks without a wanted connection are not unpacked.
///
/// `rosbag play` would sort by time of recording over the whole bag. Whoever joins streams here orders by the time of
/// *measuring*, reading each stream by a reader of its own, so that it does not matter how they are interleaved.
#[derive(Debug)]
pub struct BagReader {
    path: PathBuf,
    chunks: Vec<Chunk>,
    file: File,
    wanted: Vec<u32>,
    /// Next chunk to be unpacked.
    next: usize,
    data: Vec<u8>,
    /// Next record in `data`.
    at: usize,
}

/// A message, with its place in the unpacked chunk.
struct Found {
    connection: u32,
    time_ns: i64,
    data: Range<usize>,
    offset: u64,
}

impl BagReader {
    /// Reads the messages of the connections `wanted`.
    ///
    /// # Errors
    /// [`FormatError::Io`] if the file cannot be opened again.
    pub fn new(index: &BagIndex, wanted: &[u32]) -> Result<Self, FormatError> {
        let file = File::open(&index.path).map_err(|cause| FormatError::reading(&index.path, cause))?;
        let holds = |chunk: &&Chunk| wanted.iter().any(|id| chunk.counts.contains_key(id));
        let chunks = index.chunks.iter().filter(holds).cloned().collect();
        Ok(Self {
            path: index.path.clone(),
            chunks,
            file,
            wanted: wanted.to_vec(),
            next: 0,
            data: Vec::new(),
            at: 0,
        })
    }

    /// The next message, `None` after the last.
    ///
    /// # Errors
    /// [`FormatError::Malformed`] for a chunk that does not unpack or ends inside a message.
    pub fn next_message(&mut self) -> Result<Option<BagMessage<'_>>, FormatError> {
        let Some(Found { connection, time_ns, data, offset }) = self.find()? else { return Ok(None) };
        let data = self.data.get(data).unwrap_or_default();
        Ok(Some(BagMessage { connection, time_ns, data, offset }))
    }

    fn find(&mut self) -> Result<Option<Found>, FormatError> {
        loop {
            while self.at < self.data.len() {
                let Some(chunk) = self.next.checked_sub(1).and_then(|current| self.chunks.get(current))
                else {
                    break;
                };
                let rest = self.data.get(self.at..).unwrap_or_default();
                let Some((fields, body, after)) = split_record(rest) else {
                    return Err(chunk.damaged(&self.path, "the chunk ends inside a record"));
                };
                let record = self.at;
                self.at = self.data.len() - after.len();
                let wanted = fields.u32("conn").filter(|id| self.wanted.contains(id));
                if let (Some(op::MESSAGE), Some(id)) = (fields.op(), wanted) {
                    let Some(time_ns) = fields.time_ns("time") else {
                        return Err(chunk.damaged(&self.path, "a message in the chunk has no time"));
                    };
                    let offset = match chunk.compression {
                        Compression::None => chunk.data + record as u64,
                        _ => chunk.record,
                    };
                    let data = self.at - body.len()..self.at;
                    return Ok(Some(Found { connection: id, time_ns, data, offset }));
                }
            }
            let Some(chunk) = self.chunks.get(self.next) else { return Ok(None) };
            chunk.unpack(&mut self.file, &self.path, &mut self.data)?;
            self.next += 1;
            self.at = 0;
        }
    }
}

//! The messages of chosen connections, chunk by chunk.

use std::fs::File;
use std::ops::Range;
use std::path::PathBuf;

use super::chunk::{Chunk, Compression};
use super::{BagMessage, FileIndex};
use crate::FormatError;

/// Takes the first record off the bytes of a chunk; `None` where they end inside it.
pub(crate) type Split = fn(&[u8]) -> Option<Record>;

/// A record of a chunk.
#[derive(Debug)]
pub(crate) struct Record {
    /// Bytes of the whole record.
    pub(crate) length: usize,
    /// Connection, time of recording and place of a message.
    pub(crate) message: Option<(u32, i64, Range<usize>)>,
}

/// Streams messages of a ROS 1 bag or an MCAP file in the order in which they were written, which is the order of recording. Memory holds one
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
    split: Split,
    data: Vec<u8>,
    /// Next record in `data`.
    at: usize,
}

/// A message, with its place in the reader's buffer.
pub(crate) struct Found {
    pub(crate) connection: u32,
    pub(crate) time_ns: i64,
    pub(crate) data: Range<usize>,
    pub(crate) offset: u64,
}

impl BagReader {
    /// Reads the messages of the connections `wanted`.
    ///
    /// # Errors
    /// [`FormatError::Io`] if the file cannot be opened again.
    pub(crate) fn new(index: &FileIndex, wanted: &[u32]) -> Result<Self, FormatError> {
        let path = index.path.clone();
        let file = File::open(&path).map_err(|cause| FormatError::reading(&path, cause))?;
        let holds = |chunk: &&Chunk| wanted.iter().any(|id| chunk.counts.contains_key(id));
        let chunks = index.chunks.iter().filter(holds).cloned().collect();
        let wanted = wanted.to_vec();
        Ok(Self { path, chunks, file, wanted, next: 0, split: index.split, data: Vec::new(), at: 0 })
    }

    /// The next message, `None` after the last.
    ///
    /// # Errors
    /// [`FormatError::Malformed`] for a chunk that does not unpack or ends inside a message.
    pub fn next_message(&mut self) -> Result<Option<BagMessage<'_>>, FormatError> {
        Ok(self.find()?.map(|found| self.message(&found)))
    }

    /// The message that [`Self::find`] has found last.
    pub(crate) fn message(&self, found: &Found) -> BagMessage<'_> {
        let Found { connection, time_ns, ref data, offset } = *found;
        BagMessage { connection, time_ns, data: self.data.get(data.clone()).unwrap_or_default(), offset }
    }

    /// Goes to the next message.
    pub(crate) fn find(&mut self) -> Result<Option<Found>, FormatError> {
        loop {
            while self.at < self.data.len() {
                let Some(chunk) = self.next.checked_sub(1).and_then(|current| self.chunks.get(current))
                else {
                    break;
                };
                let rest = self.data.get(self.at..).unwrap_or_default();
                let Some(Record { length, message }) = (self.split)(rest) else {
                    return Err(chunk.damaged(&self.path, "the chunk ends inside a record"));
                };
                let record = self.at;
                self.at += length;
                let Some((connection, time_ns, data)) = message else { continue };
                if self.wanted.contains(&connection) {
                    let offset = match chunk.compression {
                        Compression::None => chunk.data + record as u64,
                        _ => chunk.record,
                    };
                    let data = record + data.start..record + data.end;
                    return Ok(Some(Found { connection, time_ns, data, offset }));
                }
            }
            let Some(chunk) = self.chunks.get(self.next) else { return Ok(None) };
            chunk.unpack(&mut self.file, &self.path, &mut self.data)?;
            self.next += 1;
            self.at = 0;
        }
    }
}

//! What a bag holds, from a walk over its records that skips the chunks' data.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use super::record::{Fields, op, split_record};
use super::walk::{Promised, REINDEX, Walk};
use crate::FormatError;
use crate::bag::chunk::{Chunk, Compression};
use crate::bag::{Connection, FileIndex, Record};
use crate::ros::Encoding;

/// What to do with a damaged chunk.
const COPY: &str = "the bag is damaged there: copy it again, or cut it with `rosbag filter`";

/// Reads the structure of bags.
#[derive(Debug)]
pub struct BagIndex {
    file: FileIndex,
}

impl BagIndex {
    /// Reads a bag's structure. A bag that was not closed (`.bag.active`) or is cut off is refused, or with
    /// `allow_truncated` taken up to its last whole chunk.
    ///
    /// # Errors
    /// [`FormatError`] naming the place of the first record that is not as it must be.
    pub fn read(path: &Path, allow_truncated: bool) -> Result<FileIndex, FormatError> {
        let mut walk = Walk::open(path)?;
        let mut index = Self { file: FileIndex::new(path, split) };
        let promised = walk.bag_header(allow_truncated)?;
        index.walk(&mut walk, allow_truncated)?;
        let whole = index.check_whole(&walk, promised, allow_truncated)?;
        if !whole || index.file.chunks.iter().any(|chunk| chunk.counts.is_empty()) {
            index.look_into_chunks()?;
        }
        Ok(index.file.counted())
    }

    fn walk(&mut self, walk: &mut Walk<'_>, allow_truncated: bool) -> Result<(), FormatError> {
        while walk.offset < walk.length {
            let record = walk.offset;
            match self.record(walk) {
                Ok(()) => {}
                Err(_) if allow_truncated => {
                    self.file.truncated_at = Some(record);
                    break;
                }
                Err(failure) => return Err(failure),
            }
        }
        Ok(())
    }

    /// Whether the walk found all that the bag's header promises. A bag that was cut between two records shows only here.
    fn check_whole(
        &mut self,
        walk: &Walk<'_>,
        promised: Option<Promised>,
        allow_truncated: bool,
    ) -> Result<bool, FormatError> {
        let Some(Promised { chunks, connections }) = promised else { return Ok(false) };
        let found = (self.file.chunks.len(), self.file.connections.len());
        if self.file.truncated_at.is_none() && found.0 >= chunks as usize && found.1 >= connections as usize {
            return Ok(true);
        }
        if !allow_truncated {
            let cause = format!(
                "the bag is cut off: it has {} of {chunks} chunks and {} of {connections} connections",
                found.0, found.1
            );
            return Err(walk.refused(walk.length, cause, REINDEX));
        }
        self.file.truncated_at.get_or_insert(walk.length);
        Ok(false)
    }

    fn record(&mut self, walk: &mut Walk<'_>) -> Result<(), FormatError> {
        let record = walk.offset;
        let data_length = walk.record_header()?;
        let fields = Fields(&walk.header);
        let missing = |name: &str| {
            FormatError::malformed(walk.path, record, format!("the record has no field {name}"), REINDEX)
        };
        match fields.op().ok_or_else(|| missing("op"))? {
            op::CHUNK => {
                let name = fields.text("compression").ok_or_else(|| missing("compression"))?;
                let compression = Compression::from_name(&name).ok_or_else(|| {
                    let cause = format!("unknown chunk compression \"{name}\"");
                    FormatError::malformed(walk.path, record, cause, "rewrite it with `rosbag decompress`")
                })?;
                let size = fields.u32("size").ok_or_else(|| missing("size"))?;
                let (data, counts) = (walk.offset, BTreeMap::new());
                let (stored, size) = (u64::from(data_length), u64::from(size));
                self.file.chunks.push(Chunk {
                    record,
                    data,
                    stored,
                    size,
                    crc: 0,
                    compression,
                    counts,
                    remedy: COPY,
                });
            }
            op::INDEX => {
                let id = fields.u32("conn").ok_or_else(|| missing("conn"))?;
                let count = fields.u32("count").ok_or_else(|| missing("count"))?;
                if let Some(chunk) = self.file.chunks.last_mut() {
                    *chunk.counts.entry(id).or_default() += u64::from(count);
                }
            }
            op::CONNECTION => {
                let (id, topic) = (fields.u32("conn"), fields.text("topic"));
                let data = walk.data(data_length)?;
                return self
                    .add_connection(id, topic, Fields(&data))
                    .map_err(|cause| FormatError::malformed(walk.path, record, cause, REINDEX));
            }
            _ => {}
        }
        walk.skip(data_length)
    }

    fn add_connection(
        &mut self,
        id: Option<u32>,
        topic: Option<String>,
        data: Fields<'_>,
    ) -> Result<(), String> {
        let (Some(id), Some(topic), Some(type_name)) = (id, topic, data.text("type")) else {
            return Err("a connection lacks its id, topic or type".to_owned());
        };
        let (encoding, metadata) = (Encoding::Ros1, BTreeMap::new());
        self.file.add(Connection { id, topic, type_name, encoding, metadata, messages: 0 })
    }

    /// Finds connections and counts inside the chunks, where the records after them are missing.
    fn look_into_chunks(&mut self) -> Result<(), FormatError> {
        let path = self.file.path.clone();
        let mut file = File::open(&path).map_err(|cause| FormatError::reading(&path, cause))?;
        let (mut data, mut chunks) = (Vec::new(), std::mem::take(&mut self.file.chunks));
        for chunk in &mut chunks {
            chunk.unpack(&mut file, &path, &mut data)?;
            chunk.counts.clear();
            let mut rest = data.as_slice();
            while let Some((fields, body, after)) = split_record(rest) {
                match (fields.op(), fields.u32("conn")) {
                    (Some(op::CONNECTION), id) => {
                        let topic = fields.text("topic");
                        self.add_connection(id, topic, Fields(body))
                            .map_err(|cause| chunk.damaged(&path, &cause))?;
                    }
                    (Some(op::MESSAGE), Some(id)) => *chunk.counts.entry(id).or_default() += 1,
                    _ => {}
                }
                rest = after;
            }
        }
        self.file.chunks = chunks;
        Ok(())
    }
}

/// The first record of a chunk's bytes.
fn split(bytes: &[u8]) -> Option<Record> {
    let (fields, body, after) = split_record(bytes)?;
    let length = bytes.len() - after.len();
    let message = match (fields.op(), fields.u32("conn"), fields.time_ns("time")) {
        (Some(op::MESSAGE), Some(id), Some(time_ns)) => Some((id, time_ns, length - body.len()..length)),
        // A message without its connection or time cannot be told from damage.
        (Some(op::MESSAGE), ..) => return None,
        _ => None,
    };
    Some(Record { length, message })
}

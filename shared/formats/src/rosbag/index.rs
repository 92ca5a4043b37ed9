//! What a bag holds, from a walk over its records that skips the chunks' data.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::chunk::{Chunk, Compression};
use super::record::{Fields, op, split_record};
use crate::FormatError;

const MAGIC: &[u8; 13] = b"#ROSBAG V2.0\n";
/// Headers of records are a few hundred bytes; more is a broken length.
const MAX_HEADER: u32 = 1 << 20;
const REINDEX: &str = "run `rosbag reindex` on a copy, or use what is before with --allow-truncated";

/// A topic's publisher.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Connection {
    /// Number that messages name it by.
    pub id: u32,
    /// Topic, for example `/livox/lidar`.
    pub topic: String,
    /// Message type, for example `sensor_msgs/Imu`.
    pub type_name: String,
    /// Messages in the whole bag.
    pub messages: u64,
}

/// The connections and chunks of a bag. Its memory grows with the number of chunks (about 100 bytes each), not with
/// their size.
#[derive(Debug, Clone)]
pub struct BagIndex {
    pub(super) path: PathBuf,
    pub(super) chunks: Vec<Chunk>,
    connections: Vec<Connection>,
    truncated_at: Option<u64>,
}

impl BagIndex {
    /// Reads a bag's structure. A bag that was not closed (`.bag.active`) or is cut off is refused, or with
    /// `allow_truncated` taken up to its last whole chunk.
    ///
    /// # Errors
    /// [`FormatError`] naming the place of the first record that is not as it must be.
    pub fn read(path: &Path, allow_truncated: bool) -> Result<Self, FormatError> {
        let file = File::open(path).map_err(|cause| FormatError::reading(path, cause))?;
        let length = file.metadata().map_err(|cause| FormatError::reading(path, cause))?.len();
        let mut walk = Walk { file: BufReader::new(file), path, length, offset: 0, header: Vec::new() };
        walk.magic()?;
        let mut index =
            Self { path: path.to_owned(), chunks: Vec::new(), connections: Vec::new(), truncated_at: None };
        let closed = walk.bag_header(allow_truncated)?;
        index.walk(&mut walk, allow_truncated)?;
        if !closed || index.truncated_at.is_some() || index.chunks.iter().any(|chunk| chunk.counts.is_empty())
        {
            index.look_into_chunks()?;
        }
        for chunk in &index.chunks {
            for (id, count) in &chunk.counts {
                if let Some(connection) = index.connections.iter_mut().find(|connection| connection.id == *id)
                {
                    connection.messages += u64::from(*count);
                }
            }
        }
        Ok(index)
    }

    /// All connections, by id.
    pub fn connections(&self) -> &[Connection] {
        &self.connections
    }

    /// Where the usable part ends, for a bag that is cut off.
    pub fn truncated_at(&self) -> Option<u64> {
        self.truncated_at
    }

    /// The file, as it was named.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn walk(&mut self, walk: &mut Walk<'_>, allow_truncated: bool) -> Result<(), FormatError> {
        while walk.offset < walk.length {
            let record = walk.offset;
            match self.record(walk) {
                Ok(()) => {}
                Err(_) if allow_truncated => {
                    self.truncated_at = Some(record);
                    break;
                }
                Err(failure) => return Err(failure),
            }
        }
        self.connections.sort_by_key(|connection| connection.id);
        Ok(())
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
                let (data, counts) = (walk.offset, Vec::new());
                self.chunks.push(Chunk { record, data, stored: data_length, size, compression, counts });
            }
            op::INDEX => {
                let id = fields.u32("conn").ok_or_else(|| missing("conn"))?;
                let count = fields.u32("count").ok_or_else(|| missing("count"))?;
                if let Some(chunk) = self.chunks.last_mut() {
                    chunk.counts.push((id, count));
                }
            }
            op::CONNECTION => {
                let (id, topic) = (fields.u32("conn"), fields.text("topic"));
                let data = walk.data(data_length)?;
                self.add_connection(id, topic, Fields(&data)).ok_or_else(|| {
                    FormatError::malformed(
                        walk.path,
                        record,
                        "the connection record lacks its id, topic or type",
                        REINDEX,
                    )
                })?;
                return Ok(());
            }
            _ => {}
        }
        walk.skip(data_length)
    }

    fn add_connection(&mut self, id: Option<u32>, topic: Option<String>, data: Fields<'_>) -> Option<()> {
        let (id, topic) = (id?, topic?);
        if self.connections.iter().all(|connection| connection.id != id) {
            self.connections.push(Connection { id, topic, type_name: data.text("type")?, messages: 0 });
        }
        Some(())
    }

    /// Finds connections and counts inside the chunks, where the records after them are missing.
    fn look_into_chunks(&mut self) -> Result<(), FormatError> {
        let path = self.path.clone();
        let mut file = File::open(&path).map_err(|cause| FormatError::reading(&path, cause))?;
        let (mut data, mut chunks) = (Vec::new(), std::mem::take(&mut self.chunks));
        for chunk in &mut chunks {
            chunk.unpack(&mut file, &path, &mut data)?;
            chunk.counts.clear();
            let mut rest = data.as_slice();
            while let Some((fields, body, after)) = split_record(rest) {
                match (fields.op(), fields.u32("conn")) {
                    (Some(op::CONNECTION), id) => {
                        let topic = fields.text("topic");
                        if self.add_connection(id, topic, Fields(body)).is_none() {
                            return Err(
                                chunk.damaged(&path, "a connection in the chunk lacks its id, topic or type")
                            );
                        }
                    }
                    (Some(op::MESSAGE), Some(id)) => {
                        match chunk.counts.iter_mut().find(|(known, _)| *known == id) {
                            Some((_, count)) => *count += 1,
                            None => chunk.counts.push((id, 1)),
                        }
                    }
                    _ => {}
                }
                rest = after;
            }
        }
        self.chunks = chunks;
        self.connections.sort_by_key(|connection| connection.id);
        Ok(())
    }
}

/// A position in the file while its records are walked over.
struct Walk<'a> {
    file: BufReader<File>,
    path: &'a Path,
    length: u64,
    offset: u64,
    header: Vec<u8>,
}

impl Walk<'_> {
    fn magic(&mut self) -> Result<(), FormatError> {
        if self.length == 0 {
            return Err(self.refused(0, "the file is empty".to_owned(), "record it again"));
        }
        let mut magic = [0; MAGIC.len()];
        let whole = self.length >= MAGIC.len() as u64;
        if whole {
            self.read(&mut magic)?;
        }
        if !whole || magic != *MAGIC {
            let remedy =
                "give a ROS 1 bag of format 2.0 (`rosbag info` shows it; ROS 2 bags are folders or MCAP)";
            return Err(self.refused(
                0,
                "this is no ROS 1 bag: it does not begin with \"#ROSBAG V2.0\"".to_owned(),
                remedy,
            ));
        }
        Ok(())
    }

    /// Whether the bag was closed: its header then says where the index is.
    fn bag_header(&mut self, allow_truncated: bool) -> Result<bool, FormatError> {
        let record = self.offset;
        let data_length = self.record_header()?;
        let fields = Fields(&self.header);
        let index = fields.u64("index_pos").filter(|_| fields.op() == Some(op::BAG_HEADER));
        let Some(index) = index else {
            return Err(self.refused(record, "the first record is not the bag's header".to_owned(), REINDEX));
        };
        if index == 0 && !allow_truncated {
            let cause = "the bag was never closed: it has no index (index_pos is 0)".to_owned();
            return Err(self.refused(record, cause, REINDEX));
        }
        if index > self.length && !allow_truncated {
            let cause = format!(
                "the bag is cut off: it has {} bytes and its index should begin at byte {index}",
                self.length
            );
            return Err(self.refused(self.length, cause, REINDEX));
        }
        self.skip(data_length)?;
        Ok(index != 0)
    }

    /// Reads a record's header into the buffer and returns the length of its data.
    fn record_header(&mut self) -> Result<u32, FormatError> {
        let record = self.offset;
        let length = self.length_field(record)?;
        if length > MAX_HEADER {
            let cause = format!("the record's header claims {length} bytes");
            return Err(self.refused(record, cause, REINDEX));
        }
        self.must_hold(record, length)?;
        let mut header = std::mem::take(&mut self.header);
        header.resize(length as usize, 0);
        let read = self.read(&mut header);
        self.header = header;
        read?;
        let length = self.length_field(record)?;
        self.must_hold(record, length)?;
        Ok(length)
    }

    fn length_field(&mut self, record: u64) -> Result<u32, FormatError> {
        self.must_hold(record, 4)?;
        let mut bytes = [0; 4];
        self.read(&mut bytes)?;
        Ok(u32::from_le_bytes(bytes))
    }

    fn data(&mut self, length: u32) -> Result<Vec<u8>, FormatError> {
        if length > MAX_HEADER {
            return Err(self.refused(self.offset, format!("the connection claims {length} bytes"), REINDEX));
        }
        let mut data = vec![0; length as usize];
        self.read(&mut data)?;
        Ok(data)
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<(), FormatError> {
        self.file.read_exact(buffer).map_err(|cause| FormatError::reading(self.path, cause))?;
        self.offset += buffer.len() as u64;
        Ok(())
    }

    fn skip(&mut self, length: u32) -> Result<(), FormatError> {
        self.offset += u64::from(length);
        self.file
            .seek(SeekFrom::Start(self.offset))
            .map_err(|cause| FormatError::reading(self.path, cause))?;
        Ok(())
    }

    fn must_hold(&self, record: u64, length: u32) -> Result<(), FormatError> {
        if self.offset + u64::from(length) <= self.length {
            return Ok(());
        }
        let cause = format!(
            "the file ends inside a record: {length} more bytes are needed at byte {}, the file has {}",
            self.offset, self.length
        );
        Err(self.refused(record, cause, REINDEX))
    }

    fn refused(&self, offset: u64, cause: String, remedy: &str) -> FormatError {
        FormatError::malformed(self.path, offset, cause, remedy)
    }
}

//! What an MCAP file holds, from a walk over its records that skips the chunks' data.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use super::record::{Fields, MAGIC, MESSAGE_HEADER, op, split_record};
use crate::FormatError;
use crate::bag::chunk::{Chunk, Compression};
use crate::bag::{Connection, FileIndex, Record};
use crate::ros::Encoding;

/// Bytes of a record before its body.
const RECORD_HEADER: u64 = 9;
/// Schemas are a few kilobytes; more is a broken length.
const MAX_SMALL_RECORD: u64 = 1 << 20;
/// Fields of a chunk before its records.
const MAX_CHUNK_HEADER: u64 = 128;
/// Messages outside of chunks are read in pieces of this size.
const MAX_LOOSE: u64 = 1 << 20;
/// As many as there may be channels.
const MAX_SCHEMAS: usize = 4096;

const RECOVER: &str = "repair a copy with `mcap recover`, or use what is before with --allow-truncated";
const DAMAGED: &str = "the file is damaged there: copy it again, or repair it with `mcap recover`";

/// Reads the structure of MCAP files.
#[derive(Debug)]
pub struct McapIndex {
    file: FileIndex,
    schemas: BTreeMap<u16, String>,
    /// All channels, those included whose messages cannot be read here.
    channels: BTreeSet<u32>,
}

/// A position in the file.
struct Walk {
    file: BufReader<File>,
    length: u64,
    offset: u64,
    body: Vec<u8>,
}

impl McapIndex {
    /// Reads a file's structure. A file that was not closed or is cut off is refused, or with `allow_truncated` taken up to
    /// its last whole record, which is its last whole chunk.
    ///
    /// # Errors
    /// [`FormatError`] naming the place of the first record that is not as it must be.
    pub fn read(path: &Path, allow_truncated: bool) -> Result<FileIndex, FormatError> {
        let file = FileIndex::new(path, split);
        let mut index = Self { file, schemas: BTreeMap::new(), channels: BTreeSet::new() };
        let mut walk = index.open()?;
        let mut closed = false;
        while !closed && walk.offset < walk.length {
            let record = walk.offset;
            match index.record(&mut walk) {
                Ok(end) => closed = end,
                Err(_) if allow_truncated => {
                    index.file.truncated_at = Some(record);
                    break;
                }
                Err(failure) => return Err(failure),
            }
        }
        if !closed && index.file.truncated_at.is_none() {
            index.file.truncated_at = Some(walk.length);
            if !allow_truncated {
                return Err(index.refused(walk.length, "the file was never closed: it has no footer"));
            }
        }
        index.look_into_chunks()?;
        Ok(index.file.counted())
    }

    fn open(&self) -> Result<Walk, FormatError> {
        let failed = |cause| FormatError::reading(&self.file.path, cause);
        let file = File::open(&self.file.path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        let mut walk = Walk { file: BufReader::new(file), length, offset: 0, body: Vec::new() };
        let mut magic = [0; 8];
        let whole = walk.file.read_exact(&mut magic).is_ok();
        walk.offset = 8;
        if whole && magic == MAGIC {
            return Ok(walk);
        }
        let cause = "this is no MCAP file: it does not begin with the magic bytes";
        Err(FormatError::malformed(&self.file.path, 0, cause, "look at it with `mcap doctor`"))
    }

    /// Takes in one record; whether it was the last one that is needed.
    fn record(&mut self, walk: &mut Walk) -> Result<bool, FormatError> {
        let record = walk.offset;
        let (kind, length) = self.record_header(walk)?;
        let body = walk.offset;
        match kind {
            op::FOOTER => return Ok(true),
            op::CHUNK => self.chunk(walk, record, length)?,
            op::SCHEMA | op::CHANNEL => {
                walk.read(&self.file.path, length, MAX_SMALL_RECORD)?;
                self.define(kind, &walk.body).map_err(|cause| self.damaged(record, cause))?;
            }
            op::MESSAGE => self.loose(walk, record, length)?,
            op::MESSAGE_INDEX => self.message_index(walk, length)?,
            // What follows repeats what was before; a footer proves that the file was closed, but its absence is no loss.
            op::DATA_END => {}
            _ => {}
        }
        walk.seek(&self.file.path, body + length)?;
        Ok(false)
    }

    fn record_header(&self, walk: &mut Walk) -> Result<(u8, u64), FormatError> {
        let record = walk.offset;
        let ends = |walk: &Walk| {
            let cause = format!("the file ends inside a record, after {} bytes", walk.length);
            self.refused(record, cause)
        };
        if walk.length - record < RECORD_HEADER {
            return Err(ends(walk));
        }
        let mut header = [0; RECORD_HEADER as usize];
        walk.file.read_exact(&mut header).map_err(|cause| FormatError::reading(&self.file.path, cause))?;
        walk.offset += RECORD_HEADER;
        let [kind, length @ ..] = header;
        let length = u64::from_le_bytes(length);
        if walk.length - walk.offset < length {
            return Err(ends(walk));
        }
        Ok((kind, length))
    }

    fn chunk(&mut self, walk: &mut Walk, record: u64, length: u64) -> Result<(), FormatError> {
        let body = walk.offset;
        walk.read(&self.file.path, length, MAX_CHUNK_HEADER)?;
        let mut fields = Fields(&walk.body);
        let mut read = || {
            let (_start, _end) = (fields.u64()?, fields.u64()?);
            Some((fields.u64()?, fields.u32()?, fields.text()?, fields.u64()?, fields.0.len()))
        };
        let Some((size, crc, compression, stored, rest)) = read() else {
            return Err(self.damaged(record, "the chunk is shorter than its header"));
        };
        let data = body + (walk.body.len() - rest) as u64;
        if data.checked_add(stored) != Some(body + length) {
            return Err(self.damaged(record, format!("the chunk of {length} bytes claims {stored} of data")));
        }
        let Some(known) = Compression::from_name(&compression) else {
            let cause = format!("unknown chunk compression \"{compression}\"");
            let remedy = "rewrite it with `mcap compress --compression lz4`";
            return Err(FormatError::malformed(&self.file.path, record, cause, remedy));
        };
        self.file.chunks.push(Chunk {
            record,
            data,
            stored,
            size,
            crc,
            compression: known,
            counts: BTreeMap::new(),
            remedy: DAMAGED,
        });
        Ok(())
    }

    /// A message outside of a chunk; those that follow each other are read together.
    fn loose(&mut self, walk: &mut Walk, record: u64, length: u64) -> Result<(), FormatError> {
        walk.read(&self.file.path, length, MESSAGE_HEADER as u64)?;
        let Some(channel) = Fields(&walk.body).u16() else {
            return Err(self.damaged(record, "the message is shorter than its header"));
        };
        let whole = RECORD_HEADER + length;
        let goes_on = |chunk: &&mut Chunk| {
            chunk.record == chunk.data
                && chunk.data + chunk.stored == record
                && chunk.stored + whole <= MAX_LOOSE
        };
        if let Some(before) = self.file.chunks.last_mut().filter(goes_on) {
            before.stored += whole;
            before.size = before.stored;
            *before.counts.entry(u32::from(channel)).or_default() += 1;
            return Ok(());
        }
        self.file.chunks.push(Chunk {
            record,
            data: record,
            stored: whole,
            size: whole,
            crc: 0,
            compression: Compression::None,
            counts: BTreeMap::from([(u32::from(channel), 1)]),
            remedy: DAMAGED,
        });
        Ok(())
    }

    /// How many messages of a channel the chunk before has.
    fn message_index(&mut self, walk: &mut Walk, length: u64) -> Result<(), FormatError> {
        walk.read(&self.file.path, length, 6)?;
        let mut fields = Fields(&walk.body);
        let (Some(channel), Some(bytes)) = (fields.u16(), fields.u32()) else { return Ok(()) };
        let count = u64::from(bytes) / 16;
        if let Some(chunk) = self.file.chunks.last_mut().filter(|_| count > 0) {
            chunk.counts.insert(u32::from(channel), count);
        }
        Ok(())
    }

    /// Takes in a schema or a channel.
    fn define(&mut self, kind: u8, body: &[u8]) -> Result<(), String> {
        let mut fields = Fields(body);
        let id = fields.u16().ok_or("a record lacks its id")?;
        if kind == op::SCHEMA {
            let name = fields.text().ok_or("a schema lacks its name")?;
            if self.schemas.len() == MAX_SCHEMAS && !self.schemas.contains_key(&id) {
                return Err(format!("there are more than {MAX_SCHEMAS} schemas"));
            }
            self.schemas.insert(id, name);
            return Ok(());
        }
        let mut read = || Some((fields.u16()?, fields.text()?, fields.text()?, fields.map()?));
        let (schema, topic, encoding, metadata) =
            read().ok_or("a channel lacks its schema, topic or encoding")?;
        self.channels.insert(u32::from(id));
        let encoding = match encoding.as_str() {
            "cdr" => Encoding::Cdr,
            "ros1" => Encoding::Ros1,
            _ => return Ok(()), // nothing that can be read here
        };
        let id = u32::from(id);
        let type_name = self.schemas.get(&schema).cloned().unwrap_or_default();
        self.file.add(Connection { id, topic, type_name, encoding, metadata, messages: 0 })
    }

    /// Finds channels and counts inside the chunks, where what should follow them is missing: always in the last chunk of a
    /// file that was cut.
    fn look_into_chunks(&mut self) -> Result<(), FormatError> {
        // Where chunks are indexed at all, one without an index holds no messages but schemas and channels.
        let counted = self.file.chunks.iter().any(|chunk| !chunk.counts.is_empty());
        let ids = self.file.chunks.iter().flat_map(|chunk| chunk.counts.keys());
        let unknown =
            !self.file.chunks.is_empty() && !counted || { ids }.any(|id| !self.channels.contains(id));
        if !unknown && self.file.truncated_at.is_none() {
            return Ok(());
        }
        let path = self.file.path.clone();
        let mut file = File::open(&path).map_err(|cause| FormatError::reading(&path, cause))?;
        let (mut data, mut chunks) = (Vec::new(), std::mem::take(&mut self.file.chunks));
        let mut usable = chunks.len();
        for (number, chunk) in chunks.iter_mut().enumerate() {
            match chunk.unpack(&mut file, &path, &mut data) {
                Ok(()) => {}
                // A power cut may leave a last chunk of the right length whose data never reached the disk.
                Err(_) if self.file.truncated_at.is_some() => {
                    (usable, self.file.truncated_at) = (number, Some(chunk.record));
                    break;
                }
                Err(failure) => return Err(failure),
            }
            chunk.counts.clear();
            let mut rest = data.as_slice();
            while let Some((kind, body, after)) = split_record(rest) {
                match kind {
                    op::SCHEMA | op::CHANNEL => {
                        self.define(kind, body).map_err(|cause| chunk.damaged(&path, &cause))?;
                    }
                    op::MESSAGE => {
                        if let Some(channel) = Fields(body).u16() {
                            *chunk.counts.entry(u32::from(channel)).or_default() += 1;
                        }
                    }
                    _ => {}
                }
                rest = after;
            }
        }
        chunks.truncate(usable);
        self.file.chunks = chunks;
        Ok(())
    }

    fn refused(&self, offset: u64, cause: impl Into<String>) -> FormatError {
        FormatError::malformed(&self.file.path, offset, cause, RECOVER)
    }

    fn damaged(&self, offset: u64, cause: impl Into<String>) -> FormatError {
        FormatError::malformed(&self.file.path, offset, cause, DAMAGED)
    }
}

impl Walk {
    /// Reads the first bytes of a record's body, at most `most`.
    fn read(&mut self, path: &Path, length: u64, most: u64) -> Result<(), FormatError> {
        self.body.resize(length.min(most) as usize, 0);
        self.file.read_exact(&mut self.body).map_err(|cause| FormatError::reading(path, cause))?;
        self.offset += self.body.len() as u64;
        Ok(())
    }

    fn seek(&mut self, path: &Path, offset: u64) -> Result<(), FormatError> {
        let step = i64::try_from(offset - self.offset).unwrap_or(i64::MAX);
        self.file.seek_relative(step).map_err(|cause| FormatError::reading(path, cause))?;
        self.offset = offset;
        Ok(())
    }
}

/// The first record of a chunk's bytes.
fn split(bytes: &[u8]) -> Option<Record> {
    let (kind, body, after) = split_record(bytes)?;
    let length = bytes.len() - after.len();
    if kind != op::MESSAGE {
        return Some(Record { length, message: None });
    }
    let mut fields = Fields(body);
    let (channel, _sequence, time) = (fields.u16()?, fields.u32()?, fields.u64()?);
    let time_ns = i64::try_from(time).unwrap_or(i64::MAX);
    let data = length - body.len().checked_sub(MESSAGE_HEADER)?..length;
    Some(Record { length, message: Some((u32::from(channel), time_ns, data)) })
}

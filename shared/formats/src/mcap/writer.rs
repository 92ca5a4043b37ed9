//! Writes MCAP files chunk by chunk: schemas and channels first, then messages, which are put together in memory.

use std::collections::BTreeMap;
use std::io::{self, Write};

use super::record::{MAGIC, op};
use super::summary::{ChunkPlace, Summary};

/// How chunks are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packing {
    /// As they are.
    None,
    /// In LZ4's frame format.
    Lz4,
}

/// What closes a file behind its last whole chunk where there is no room for a summary: end of the data, a footer that names no
/// summary, magic bytes.
pub const BARE_END: [u8; 50] = bare_end();

const fn bare_end() -> [u8; 50] {
    let mut end = [0; 50];
    (end[0], end[1]) = (op::DATA_END, 4);
    (end[13], end[14]) = (op::FOOTER, 20);
    let mut at = 0;
    while at < MAGIC.len() {
        end[42 + at] = MAGIC[at];
        at += 1;
    }
    end
}

/// Writes one file. Nothing of a chunk reaches `out` before [`Self::end_chunk`]; after warm-up a message costs no allocation.
#[derive(Debug)]
pub struct McapWriter<W> {
    out: W,
    /// Bytes in `out`.
    position: u64,
    packing: Packing,
    /// Records of the chunk that is being filled, and its messages' times.
    chunk: Vec<u8>,
    times: Option<(u64, u64)>,
    /// For each channel the messages in the chunk: time and place.
    indexes: Vec<Vec<(u64, u64)>>,
    packed: Vec<u8>,
    record: Vec<u8>,
    summary: Summary,
}

impl<W: Write> McapWriter<W> {
    /// Begins a file with its magic bytes and header.
    ///
    /// # Errors
    /// Those of `out`, as everywhere here.
    pub fn new(out: W, profile: &str, library: &str, packing: Packing) -> io::Result<Self> {
        let mut writer = Self {
            out,
            position: 0,
            packing,
            chunk: Vec::new(),
            times: None,
            indexes: Vec::new(),
            packed: Vec::new(),
            record: Vec::new(),
            summary: Summary::default(),
        };
        writer.put(&MAGIC)?;
        writer.put_record(op::HEADER, |body| {
            text(body, profile);
            text(body, library);
        })?;
        Ok(writer)
    }

    /// Adds a message type; gives its number.
    ///
    /// # Errors
    /// Those of `out`; more than 65,535 schemas.
    pub fn add_schema(&mut self, name: &str, encoding: &str, data: &[u8]) -> io::Result<u16> {
        // 0 means none.
        let id = u16::try_from(self.summary.schemas + 1).map_err(io::Error::other)?;
        self.put_record(op::SCHEMA, |body| {
            body.extend(id.to_le_bytes());
            text(body, name);
            text(body, encoding);
            bytes(body, data);
        })?;
        self.summary.add_schema(&self.record);
        Ok(id)
    }

    /// Adds a topic; gives its number.
    ///
    /// # Errors
    /// Those of `out`; more than 65,536 channels.
    pub fn add_channel(
        &mut self,
        schema: u16,
        topic: &str,
        encoding: &str,
        metadata: &BTreeMap<String, String>,
    ) -> io::Result<u16> {
        let id = u16::try_from(self.indexes.len()).map_err(io::Error::other)?;
        self.put_record(op::CHANNEL, |body| {
            body.extend(id.to_le_bytes());
            body.extend(schema.to_le_bytes());
            text(body, topic);
            text(body, encoding);
            let mut pairs = Vec::new();
            for (key, value) in metadata {
                text(&mut pairs, key);
                text(&mut pairs, value);
            }
            bytes(body, &pairs);
        })?;
        self.indexes.push(Vec::new());
        self.summary.add_channel(&self.record);
        Ok(id)
    }

    /// Puts a file into the file.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn attach(&mut self, name: &str, media_type: &str, data: &[u8]) -> io::Result<()> {
        let place = self.position;
        self.put_record(op::ATTACHMENT, |body| {
            let from = body.len();
            // Neither logged nor created at a time that counts.
            body.extend([0; 16]);
            text(body, name);
            text(body, media_type);
            body.extend((data.len() as u64).to_le_bytes());
            body.extend(data);
            let sum = crc32fast::hash(body.get(from..).unwrap_or_default());
            body.extend(sum.to_le_bytes());
        })?;
        self.summary.add_attachment(place, self.position - place, data.len() as u64, name, media_type);
        Ok(())
    }

    /// Adds a message to the chunk. A channel that was not added is left out.
    pub fn write(&mut self, channel: u16, sequence: u32, time_ns: u64, message: &[u8]) {
        let Some(index) = self.indexes.get_mut(usize::from(channel)) else { return };
        index.push((time_ns, self.chunk.len() as u64));
        let (first, last) = self.times.unwrap_or((time_ns, time_ns));
        self.times = Some((first.min(time_ns), last.max(time_ns)));
        record(&mut self.chunk, op::MESSAGE, |body| {
            body.extend(channel.to_le_bytes());
            body.extend(sequence.to_le_bytes());
            // Logged and published.
            body.extend(time_ns.to_le_bytes());
            body.extend(time_ns.to_le_bytes());
            body.extend(message);
        });
    }

    /// Ends the chunk, hands it to `out` with its index, and flushes that. Gives the bytes in the file.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn end_chunk(&mut self) -> io::Result<u64> {
        if let Some(times) = self.times.take() {
            self.put_chunk(times)?;
        }
        self.out.flush()?;
        Ok(self.position)
    }

    /// Ends the file; gives what it was written to.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn finish(mut self) -> io::Result<W> {
        self.end_chunk()?;
        self.put_record(op::DATA_END, |body| body.extend([0; 4]))?;
        let mut end = Vec::new();
        self.summary.write(self.position, &mut end);
        self.put(&end)?;
        self.put(&MAGIC)?;
        self.out.flush()?;
        Ok(self.out)
    }

    fn put_chunk(&mut self, (first, last): (u64, u64)) -> io::Result<()> {
        let place = self.position;
        let name = match self.packing {
            Packing::None => "",
            Packing::Lz4 => {
                self.packed.clear();
                let mut encoder = lz4_flex::frame::FrameEncoder::new(std::mem::take(&mut self.packed));
                encoder.write_all(&self.chunk)?;
                self.packed = encoder.finish().map_err(io::Error::other)?;
                "lz4"
            }
        };
        let stored = if self.packing == Packing::None { &self.chunk } else { &self.packed };
        let (stored_bytes, size) = (stored.len() as u64, self.chunk.len() as u64);
        self.record.clear();
        self.record.push(op::CHUNK);
        self.record.extend((8 + 8 + 8 + 4 + 4 + name.len() as u64 + 8 + stored_bytes).to_le_bytes());
        for number in [first, last, size] {
            self.record.extend(number.to_le_bytes());
        }
        self.record.extend(crc32fast::hash(&self.chunk).to_le_bytes());
        text(&mut self.record, name);
        self.record.extend(stored_bytes.to_le_bytes());
        self.out.write_all(&self.record)?;
        self.out.write_all(stored)?;
        self.position += self.record.len() as u64 + stored_bytes;
        let chunk = ChunkPlace {
            times: (first, last),
            place,
            length: self.position - place,
            packing: name,
            stored: stored_bytes,
            size,
        };
        self.put_indexes(&chunk)?;
        self.chunk.clear();
        Ok(())
    }

    /// The chunk's messages by channel, behind it.
    fn put_indexes(&mut self, chunk: &ChunkPlace) -> io::Result<()> {
        let Self { out, position, indexes, record: buffer, summary, .. } = self;
        summary.begin_chunk();
        let from = *position;
        for (messages, channel) in
            indexes.iter_mut().zip(0_u16..).filter(|(messages, _)| !messages.is_empty())
        {
            buffer.clear();
            record(buffer, op::MESSAGE_INDEX, |body| {
                body.extend(channel.to_le_bytes());
                body.extend((messages.len() as u32 * 16).to_le_bytes());
                for (time_ns, place) in messages.iter() {
                    body.extend(time_ns.to_le_bytes());
                    body.extend(place.to_le_bytes());
                }
            });
            summary.add_index(channel, *position, messages.len() as u64);
            out.write_all(buffer)?;
            *position += buffer.len() as u64;
            messages.clear();
        }
        summary.end_chunk(chunk, *position - from);
        Ok(())
    }

    /// Writes a record, which stays in `self.record`.
    fn put_record(&mut self, kind: u8, fill: impl FnOnce(&mut Vec<u8>)) -> io::Result<()> {
        self.record.clear();
        record(&mut self.record, kind, fill);
        self.out.write_all(&self.record)?;
        self.position += self.record.len() as u64;
        Ok(())
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.out.write_all(bytes)?;
        self.position += bytes.len() as u64;
        Ok(())
    }
}

/// Appends a record: its kind, its length, its body.
pub(super) fn record(out: &mut Vec<u8>, kind: u8, fill: impl FnOnce(&mut Vec<u8>)) {
    out.push(kind);
    let length = out.len();
    out.extend([0; 8]);
    let from = out.len();
    fill(out);
    let bytes = (out.len() - from) as u64;
    if let Some(place) = out.get_mut(length..from) {
        place.copy_from_slice(&bytes.to_le_bytes());
    }
}

/// Appends a string behind its length.
pub(super) fn text(out: &mut Vec<u8>, text: &str) {
    bytes(out, text.as_bytes());
}

fn bytes(out: &mut Vec<u8>, data: &[u8]) {
    out.extend((data.len() as u32).to_le_bytes());
    out.extend(data);
}

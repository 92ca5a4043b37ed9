//! What stands at a file's end, so that readers find everything without going through it.

use std::collections::BTreeMap;

use super::record::op;
use super::writer::{record, text};

/// A chunk that was written.
#[derive(Debug)]
pub(super) struct ChunkPlace {
    /// Of its first and last message.
    pub(super) times: (u64, u64),
    pub(super) place: u64,
    /// Of its record.
    pub(super) length: u64,
    pub(super) packing: &'static str,
    pub(super) stored: u64,
    pub(super) size: u64,
}

/// The records of a summary as they will be written, group by group.
#[derive(Debug, Default)]
pub(super) struct Summary {
    pub(super) schemas: u32,
    schema_records: Vec<u8>,
    channels: u32,
    channel_records: Vec<u8>,
    chunks: u32,
    chunk_records: Vec<u8>,
    attachments: u32,
    attachment_records: Vec<u8>,
    /// Messages of each channel.
    messages: BTreeMap<u16, u64>,
    times: Option<(u64, u64)>,
    /// Places of the message indexes of the chunk at hand, as a map.
    indexes: Vec<u8>,
}

impl Summary {
    pub(super) fn add_schema(&mut self, record: &[u8]) {
        self.schemas += 1;
        self.schema_records.extend(record);
    }

    pub(super) fn add_channel(&mut self, record: &[u8]) {
        self.channels += 1;
        self.channel_records.extend(record);
    }

    pub(super) fn add_attachment(
        &mut self,
        place: u64,
        length: u64,
        size: u64,
        name: &str,
        media_type: &str,
    ) {
        self.attachments += 1;
        record(&mut self.attachment_records, op::ATTACHMENT_INDEX, |body| {
            for number in [place, length, 0, 0, size] {
                body.extend(number.to_le_bytes());
            }
            text(body, name);
            text(body, media_type);
        });
    }

    pub(super) fn begin_chunk(&mut self) {
        self.indexes.clear();
    }

    pub(super) fn add_index(&mut self, channel: u16, place: u64, messages: u64) {
        self.indexes.extend(channel.to_le_bytes());
        self.indexes.extend(place.to_le_bytes());
        *self.messages.entry(channel).or_default() += messages;
    }

    pub(super) fn end_chunk(&mut self, chunk: &ChunkPlace, index_length: u64) {
        self.chunks += 1;
        let (first, last) = self.times.unwrap_or(chunk.times);
        self.times = Some((first.min(chunk.times.0), last.max(chunk.times.1)));
        let indexes = &self.indexes;
        record(&mut self.chunk_records, op::CHUNK_INDEX, |body| {
            for number in [chunk.times.0, chunk.times.1, chunk.place, chunk.length] {
                body.extend(number.to_le_bytes());
            }
            body.extend((indexes.len() as u32).to_le_bytes());
            body.extend(indexes);
            body.extend(index_length.to_le_bytes());
            text(body, chunk.packing);
            body.extend(chunk.stored.to_le_bytes());
            body.extend(chunk.size.to_le_bytes());
        });
    }

    /// Appends the summary, which begins at `place` of the file, and the footer.
    pub(super) fn write(&self, place: u64, out: &mut Vec<u8>) {
        let mut statistics = Vec::new();
        record(&mut statistics, op::STATISTICS, |body| self.statistics(body));
        let groups = [
            (op::SCHEMA, &self.schema_records),
            (op::CHANNEL, &self.channel_records),
            (op::CHUNK_INDEX, &self.chunk_records),
            (op::ATTACHMENT_INDEX, &self.attachment_records),
            (op::STATISTICS, &statistics),
        ];
        let from = out.len();
        let mut offsets = Vec::new();
        for (kind, records) in groups.into_iter().filter(|(_, records)| !records.is_empty()) {
            let start = place + (out.len() - from) as u64;
            record(&mut offsets, op::SUMMARY_OFFSET, |body| {
                body.push(kind);
                body.extend(start.to_le_bytes());
                body.extend((records.len() as u64).to_le_bytes());
            });
            out.extend(records);
        }
        let offsets_start = place + (out.len() - from) as u64;
        out.extend(offsets);
        record(out, op::FOOTER, |out| {
            out.extend(place.to_le_bytes());
            out.extend(offsets_start.to_le_bytes());
            out.extend([0; 4]);
        });
        // The sum counts everything from the summary's first byte up to itself, the footer's length included.
        let end = out.len() - 4;
        let sum = crc32fast::hash(out.get(from..end).unwrap_or_default());
        if let Some(place) = out.get_mut(end..) {
            place.copy_from_slice(&sum.to_le_bytes());
        }
    }

    fn statistics(&self, body: &mut Vec<u8>) {
        body.extend(self.messages.values().sum::<u64>().to_le_bytes());
        body.extend((self.schemas as u16).to_le_bytes());
        for number in [self.channels, self.attachments, 0, self.chunks] {
            body.extend(number.to_le_bytes());
        }
        let (first, last) = self.times.unwrap_or_default();
        body.extend(first.to_le_bytes());
        body.extend(last.to_le_bytes());
        body.extend((self.messages.len() as u32 * 10).to_le_bytes());
        for (channel, messages) in &self.messages {
            body.extend(channel.to_le_bytes());
            body.extend(messages.to_le_bytes());
        }
    }
}

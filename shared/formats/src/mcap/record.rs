//! The fields of records: little-endian numbers, and strings behind their length.

use std::collections::BTreeMap;

/// Kinds of records.
pub(super) mod op {
    pub(in crate::mcap) const HEADER: u8 = 0x01;
    pub(in crate::mcap) const FOOTER: u8 = 0x02;
    pub(in crate::mcap) const SCHEMA: u8 = 0x03;
    pub(in crate::mcap) const CHANNEL: u8 = 0x04;
    pub(in crate::mcap) const MESSAGE: u8 = 0x05;
    pub(in crate::mcap) const CHUNK: u8 = 0x06;
    pub(in crate::mcap) const MESSAGE_INDEX: u8 = 0x07;
    pub(in crate::mcap) const CHUNK_INDEX: u8 = 0x08;
    pub(in crate::mcap) const ATTACHMENT: u8 = 0x09;
    pub(in crate::mcap) const ATTACHMENT_INDEX: u8 = 0x0a;
    pub(in crate::mcap) const STATISTICS: u8 = 0x0b;
    pub(in crate::mcap) const SUMMARY_OFFSET: u8 = 0x0e;
    pub(in crate::mcap) const DATA_END: u8 = 0x0f;
}

/// A file begins and ends with it.
pub(super) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
/// Bytes of a message record's body before the message.
pub(super) const MESSAGE_HEADER: usize = 22;

/// Reads fields one after the other; `None` where the bytes end.
#[derive(Debug)]
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Fields<'a> {
    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (array, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*array)
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Pairs of strings behind their length in bytes.
    pub(super) fn map(&mut self) -> Option<BTreeMap<String, String>> {
        let length = self.u32()? as usize;
        let (pairs, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        let (mut fields, mut map) = (Fields(pairs), BTreeMap::new());
        while !fields.0.is_empty() {
            map.insert(fields.text()?, fields.text()?);
        }
        Some(map)
    }

    pub(super) fn text(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        let (text, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(String::from_utf8_lossy(text).into_owned())
    }
}

/// A record at the start of `bytes`: its kind, its body and the bytes after it; `None` where they end inside it.
pub(super) fn split_record(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (kind, rest) = bytes.split_first()?;
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let (body, rest) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    Some((*kind, body, rest))
}

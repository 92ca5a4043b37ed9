//! A base and the log after it become the next base: what the stage itself need not take part in.

use std::io::{self, Write};
use std::path::Path;

use evac_frames::Voxel;

use super::Entry;
use super::file::{Head, Reader, encode};

/// Voxels of one entry of a base.
const CHUNK: usize = 65_536;

fn key(voxel: &Voxel) -> u64 {
    voxel.key.iter().fold(0, |key, axis| key << 16 | u64::from(*axis))
}

/// Writes entries of bounded size, and what holds now with the last.
struct Base<'a> {
    writer: &'a mut dyn Write,
    head: Head,
    entry: Entry,
    bytes: Vec<u8>,
}

impl Base<'_> {
    fn voxel(&mut self, voxel: Voxel) -> io::Result<()> {
        // Forgotten.
        if voxel.flags == 0 {
            return Ok(());
        }
        self.entry.voxels.push(voxel);
        if self.entry.voxels.len() < CHUNK { Ok(()) } else { self.flush() }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.bytes.clear();
        encode(self.head, &self.entry, &mut self.bytes);
        self.entry.clear();
        self.writer.write_all(&self.bytes)
    }

    fn finish(mut self, now: &[u8]) -> io::Result<()> {
        self.entry.now.set_bytes(now);
        self.flush()
    }
}

/// Writes a base from one entry that holds everything.
pub(super) fn write_whole(head: Head, entry: &mut Entry, writer: &mut dyn Write) -> io::Result<()> {
    entry.voxels.sort_unstable_by_key(key);
    let mut base = Base { writer, head, entry: Entry::default(), bytes: Vec::new() };
    base.entry.added.set_bytes(entry.added.bytes());
    entry.voxels.iter().try_for_each(|voxel| base.voxel(*voxel))?;
    base.finish(entry.now.bytes())
}

/// Writes the base that follows from a base and its log. Memory goes with the log.
pub(super) fn merge(old_base: &Path, log: &Path, writer: &mut dyn Write) -> io::Result<()> {
    let mut entry = Entry::default();
    let (mut news, mut added, mut now, mut newest) = (Vec::new(), Vec::new(), Vec::new(), Head::default());
    if let Some(mut log) = Reader::open(log)? {
        while let Some(head) = log.next(&mut entry)? {
            newest = head;
            now = entry.now.bytes().to_vec();
            added.extend_from_slice(entry.added.bytes());
            news.append(&mut entry.voxels);
        }
    }
    // Stable: of several of one key the last is the newest.
    news.sort_by_key(key);
    news.reverse();
    news.dedup_by_key(|voxel| key(voxel));
    let mut base = Base { writer, head: newest, entry: Entry::default(), bytes: Vec::new() };
    if let Some(mut old) = Reader::open(old_base)? {
        while old.next(&mut entry)?.is_some() {
            if !entry.added.bytes().is_empty() {
                base.entry.added.set_bytes(entry.added.bytes());
                base.flush()?;
            }
            for voxel in &entry.voxels {
                while news.last().is_some_and(|new| key(new) < key(voxel)) {
                    news.pop().map_or(Ok(()), |new| base.voxel(new))?;
                }
                let is_old = news.last().is_some_and(|new| key(new) == key(voxel));
                if !is_old {
                    base.voxel(*voxel)?;
                }
            }
        }
    }
    while let Some(new) = news.pop() {
        base.voxel(new)?;
    }
    base.entry.added.set_bytes(&added);
    base.finish(&now)
}

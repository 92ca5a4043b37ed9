//! The data of a chunk, unpacked.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use crate::FormatError;

/// Larger chunks are refused before memory is taken for them (`rosbag record` makes 768 KiB).
const MAX_CHUNK: u32 = 512 << 20;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Bz2,
    Lz4,
}

impl Compression {
    pub(super) fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "none" => Self::None,
            "bz2" => Self::Bz2,
            "lz4" => Self::Lz4,
            _ => return None,
        })
    }
}

/// Where a chunk lies and what it holds.
#[derive(Debug, Clone)]
pub(super) struct Chunk {
    /// Start of its record in the file.
    pub(super) record: u64,
    /// Start and length of its data.
    pub(super) data: u64,
    pub(super) stored: u32,
    /// Length after unpacking.
    pub(super) size: u32,
    pub(super) compression: Compression,
    /// Connections of its messages and how many each has.
    pub(super) counts: BTreeMap<u32, u64>,
}

impl Chunk {
    /// Replaces `out` by the unpacked data.
    pub(super) fn unpack(&self, file: &mut File, path: &Path, out: &mut Vec<u8>) -> Result<(), FormatError> {
        out.clear();
        if self.size > MAX_CHUNK {
            return Err(
                self.damaged(path, &format!("the chunk claims {} bytes, more than {MAX_CHUNK}", self.size))
            );
        }
        file.seek(SeekFrom::Start(self.data)).map_err(|cause| FormatError::reading(path, cause))?;
        let stored = file.take(u64::from(self.stored));
        // One byte more than announced shows a chunk that is longer, without unpacking all of it.
        let limit = u64::from(self.size) + 1;
        let unpacked = match self.compression {
            Compression::None => stored.take(limit).read_to_end(out),
            Compression::Bz2 => bzip2::read::BzDecoder::new(stored).take(limit).read_to_end(out),
            Compression::Lz4 => lz4_flex::frame::FrameDecoder::new(stored).take(limit).read_to_end(out),
        };
        match unpacked {
            Ok(length) if length == self.size as usize => Ok(()),
            Ok(length) => {
                Err(self
                    .damaged(path, &format!("the chunk unpacks to {length} bytes instead of {}", self.size)))
            }
            Err(cause) => {
                Err(self
                    .damaged(path, &format!("the chunk ({:?}) does not unpack: {cause}", self.compression)))
            }
        }
    }

    pub(super) fn damaged(&self, path: &Path, cause: &str) -> FormatError {
        FormatError::malformed(
            path,
            self.record,
            cause,
            "the bag is damaged there: copy it again, or cut it with `rosbag filter`",
        )
    }
}

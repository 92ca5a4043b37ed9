//! The data of a chunk of a ROS 1 bag or an MCAP file, unpacked.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use crate::FormatError;

/// Larger chunks are refused before memory is taken for them (`rosbag record` makes 768 KiB, MCAP writers up to some MiB).
const MAX_CHUNK: u64 = 512 << 20;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Compression {
    None,
    Bz2,
    Lz4,
    Zstd,
}

impl Compression {
    pub(crate) fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "none" | "" => Self::None,
            "bz2" => Self::Bz2,
            "lz4" => Self::Lz4,
            "zstd" => Self::Zstd,
            _ => return None,
        })
    }
}

/// Where a chunk lies and what it holds.
#[derive(Debug, Clone)]
pub(crate) struct Chunk {
    /// Start of its record in the file.
    pub(crate) record: u64,
    /// Start and length of its data.
    pub(crate) data: u64,
    pub(crate) stored: u64,
    /// Length after unpacking.
    pub(crate) size: u64,
    /// CRC-32 of the unpacked data; 0 where the file gives none.
    pub(crate) crc: u32,
    pub(crate) compression: Compression,
    /// Connections of its messages and how many each has.
    pub(crate) counts: BTreeMap<u32, u64>,
    /// What to do when it is damaged.
    pub(crate) remedy: &'static str,
}

impl Chunk {
    /// Replaces `out` by the unpacked data.
    pub(crate) fn unpack(&self, file: &mut File, path: &Path, out: &mut Vec<u8>) -> Result<(), FormatError> {
        out.clear();
        if self.size > MAX_CHUNK {
            return Err(
                self.damaged(path, &format!("the chunk claims {} bytes, more than {MAX_CHUNK}", self.size))
            );
        }
        file.seek(SeekFrom::Start(self.data)).map_err(|cause| FormatError::reading(path, cause))?;
        let stored = file.take(self.stored);
        // One byte more than announced shows a chunk that is longer, without unpacking all of it.
        let limit = self.size + 1;
        let unpacked = match self.compression {
            Compression::None => stored.take(limit).read_to_end(out),
            Compression::Bz2 => bzip2::read::BzDecoder::new(stored).take(limit).read_to_end(out),
            Compression::Zstd => unpack_zstd(stored, limit, out),
            Compression::Lz4 => lz4_flex::frame::FrameDecoder::new(stored).take(limit).read_to_end(out),
        };
        match unpacked {
            Ok(length) if length as u64 == self.size => self.check(path, out),
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

    pub(crate) fn damaged(&self, path: &Path, cause: &str) -> FormatError {
        FormatError::malformed(path, self.record, cause, self.remedy)
    }

    fn check(&self, path: &Path, data: &[u8]) -> Result<(), FormatError> {
        if self.crc == 0 || crc32fast::hash(data) == self.crc {
            return Ok(());
        }
        Err(self.damaged(path, "the chunk's checksum does not fit its data"))
    }
}

fn unpack_zstd(stored: impl Read, limit: u64, out: &mut Vec<u8>) -> std::io::Result<usize> {
    let decoder = ruzstd::decoding::StreamingDecoder::new(stored).map_err(std::io::Error::other)?;
    decoder.take(limit).read_to_end(out)
}

//! A walk from record to record of a bag, each checked against the file's length before memory is taken for it.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::record::{Fields, op};
use crate::FormatError;

/// What to do with a bag that is not whole.
pub(super) const REINDEX: &str =
    "run `rosbag reindex` on a copy, or use what is before with --allow-truncated";

const MAGIC: &[u8; 13] = b"#ROSBAG V2.0\n";
/// Headers of records are a few hundred bytes; more is a broken length.
const MAX_HEADER: u32 = 1 << 20;

/// What the header of a closed bag says is in it.
pub(super) struct Promised {
    pub(super) chunks: u32,
    pub(super) connections: u32,
}

/// A position in the file while its records are walked over.
pub(super) struct Walk<'a> {
    file: BufReader<File>,
    pub(super) path: &'a Path,
    /// Of the file, bytes.
    pub(super) length: u64,
    pub(super) offset: u64,
    /// Fields of the last record whose header was read.
    pub(super) header: Vec<u8>,
}

impl<'a> Walk<'a> {
    /// Opens a bag and stands before its first record.
    pub(super) fn open(path: &'a Path) -> Result<Self, FormatError> {
        let file = File::open(path).map_err(|cause| FormatError::reading(path, cause))?;
        let length = file.metadata().map_err(|cause| FormatError::reading(path, cause))?.len();
        let mut walk = Self { file: BufReader::new(file), path, length, offset: 0, header: Vec::new() };
        walk.magic()?;
        Ok(walk)
    }

    /// What the bag should hold; `None` for one that was never closed.
    pub(super) fn bag_header(&mut self, allow_truncated: bool) -> Result<Option<Promised>, FormatError> {
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
        let count = |name: &str| fields.u32(name).unwrap_or_default();
        let promised = Promised { chunks: count("chunk_count"), connections: count("conn_count") };
        self.skip(data_length)?;
        Ok((index != 0).then_some(promised))
    }

    /// Reads a record's header into the buffer and returns the length of its data.
    pub(super) fn record_header(&mut self) -> Result<u32, FormatError> {
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
            let remedy = "give a ROS 1 bag of format 2.0, an MCAP or db3 file, or the folder of a ROS 2 bag";
            return Err(self.refused(
                0,
                "this is no bag: it does not begin with \"#ROSBAG V2.0\"".to_owned(),
                remedy,
            ));
        }
        Ok(())
    }

    fn length_field(&mut self, record: u64) -> Result<u32, FormatError> {
        self.must_hold(record, 4)?;
        let mut bytes = [0; 4];
        self.read(&mut bytes)?;
        Ok(u32::from_le_bytes(bytes))
    }

    pub(super) fn data(&mut self, length: u32) -> Result<Vec<u8>, FormatError> {
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

    pub(super) fn skip(&mut self, length: u32) -> Result<(), FormatError> {
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

    pub(super) fn refused(&self, offset: u64, cause: String, remedy: &str) -> FormatError {
        FormatError::malformed(self.path, offset, cause, remedy)
    }
}

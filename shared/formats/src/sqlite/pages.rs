//! The pages of a database file.

use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use crate::FormatError;

const MAGIC: &[u8; 16] = b"SQLite format 3\0";
/// What to try with a damaged file.
const RECOVER: &str = "copy it again, or repair it with `sqlite3 FILE .recover`";

/// A database file. Pages are read when they are needed.
#[derive(Debug)]
pub(crate) struct Database {
    path: PathBuf,
    file: File,
    page_size: u64,
    /// Bytes of a page that hold data.
    pub(super) usable: usize,
    /// Whole pages in the file.
    pub(super) pages: u64,
}

impl Database {
    /// Opens a file and checks its header.
    ///
    /// # Errors
    /// [`FormatError`] if it is no database, or has changes beside it that were never moved into it.
    pub(crate) fn open(path: &Path) -> Result<Self, FormatError> {
        let failed = |cause| FormatError::reading(path, cause);
        let file = File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        let refused =
            |offset, cause: String, remedy: &str| FormatError::malformed(path, offset, cause, remedy);
        let mut header = [0; 100];
        if length < 100 || file.read_exact_at(&mut header, 0).is_err() || !header.starts_with(MAGIC) {
            return Err(refused(0, "this is no SQLite 3 database".to_owned(), "check the file"));
        }
        let page_size = match u16::from_be_bytes([header[16], header[17]]) {
            1 => 65_536,
            size => u64::from(size),
        };
        let reserved = u64::from(header[20]);
        if !page_size.is_power_of_two() || page_size < 512 || page_size - reserved < 480 {
            let cause = format!("pages of {page_size} bytes, {reserved} of them reserved, do not exist");
            return Err(refused(16, cause, RECOVER));
        }
        // 0 in a database without any table.
        let encoding = header[59];
        if header[56..59] != [0; 3] || encoding > 1 {
            return Err(refused(56, "its texts are not UTF-8".to_owned(), "write the bag with rosbag2"));
        }
        let usable = (page_size - reserved) as usize;
        Ok(Self { path: path.to_owned(), file, page_size, usable, pages: length / page_size })
    }

    /// The file, as it was named.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes beside the file that belong to it and that only SQLite can move into it: a recorder did not end properly.
    pub(crate) fn unmerged(&self) -> Option<PathBuf> {
        ["-wal", "-journal"].into_iter().find_map(|ending| {
            let mut name = self.path.clone().into_os_string();
            name.push(ending);
            let path = PathBuf::from(name);
            path.metadata().is_ok_and(|file| file.len() > 0).then_some(path)
        })
    }

    /// Where page `number` begins; the first is 1.
    pub(super) fn offset(&self, number: u32) -> u64 {
        u64::from(number).saturating_sub(1) * self.page_size
    }

    /// Appends a page's usable bytes from `skip` on, at most `most`, to `out`.
    pub(super) fn append(
        &self,
        number: u32,
        skip: usize,
        most: usize,
        out: &mut Vec<u8>,
    ) -> Result<(), FormatError> {
        if number == 0 || u64::from(number) > self.pages {
            let cause = format!("page {number} is needed and the file has {}", self.pages);
            return Err(self.damaged(self.offset(number), cause));
        }
        let start = out.len();
        out.resize(start + most.min(self.usable.saturating_sub(skip)), 0);
        let to = out.get_mut(start..).unwrap_or_default();
        self.file
            .read_exact_at(to, self.offset(number) + skip as u64)
            .map_err(|cause| FormatError::reading(&self.path, cause))
    }

    pub(super) fn damaged(&self, offset: u64, cause: impl Into<String>) -> FormatError {
        FormatError::malformed(&self.path, offset, cause, RECOVER)
    }
}

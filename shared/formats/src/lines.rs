//! Text lines with their places in the file, each of bounded length.

use std::io::{BufRead, Read as _};
use std::path::{Path, PathBuf};

use crate::FormatError;

/// Longest line that is read; no text format here comes near it, a binary file taken for text does.
const LONGEST_LINE: u64 = 64 * 1024;

/// Reads lines and knows the byte at which each starts.
pub(crate) struct Lines<R> {
    source: R,
    path: PathBuf,
    offset: u64,
    buffer: Vec<u8>,
}

/// A line without its end.
pub(crate) struct Line<'a> {
    pub(crate) start: u64,
    pub(crate) text: &'a str,
}

impl<R: BufRead> Lines<R> {
    pub(crate) fn new(source: R, path: &Path) -> Self {
        Self { source, path: path.to_owned(), offset: 0, buffer: Vec::new() }
    }

    /// The next line; `None` at the end of the file.
    pub(crate) fn next_line(&mut self) -> Result<Option<Line<'_>>, FormatError> {
        let start = self.offset;
        self.buffer.clear();
        let read = self
            .source
            .by_ref()
            .take(LONGEST_LINE)
            .read_until(b'\n', &mut self.buffer)
            .map_err(|cause| FormatError::reading(&self.path, cause))?;
        if read == 0 {
            return Ok(None);
        }
        self.offset += read as u64;
        let Some(line) = self
            .buffer
            .strip_suffix(b"\n")
            .or((self.buffer.len() < LONGEST_LINE as usize).then_some(self.buffer.as_slice()))
        else {
            let cause = format!("a line longer than {LONGEST_LINE} bytes");
            return Err(FormatError::malformed(
                &self.path,
                start,
                cause,
                "check that this is the right kind of file",
            ));
        };
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        match std::str::from_utf8(line) {
            Ok(text) => Ok(Some(Line { start, text })),
            Err(fault) => Err(FormatError::malformed(
                &self.path,
                start + fault.valid_up_to() as u64,
                "the text is not UTF-8",
                "check that this is the right kind of file",
            )),
        }
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes read so far.
    pub(crate) fn offset(&self) -> u64 {
        self.offset
    }

    /// What follows the lines read so far; the caller counts its bytes from [`Self::offset`].
    pub(crate) fn source(&mut self) -> &mut R {
        &mut self.source
    }
}

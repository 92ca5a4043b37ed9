//! Reads a byte log sample by sample.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use super::frame::FRAME_BYTES;
use super::parser::Parser;
use super::sample::{Assembler, RawSample};
use crate::FormatError;

/// Bytes without a single good frame after which a log is given up: almost a second of two frames at 200 Hz.
const MAX_JUNK: u64 = 4096;

/// What a reader has come across.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Wt901cCounts {
    /// Bytes read.
    pub bytes: u64,
    /// Frames with a right sum, of any kind.
    pub frames: u64,
    /// Whole samples handed out.
    pub samples: u64,
    /// Samples dropped because one of their frames was missing.
    pub incomplete: u64,
    /// Bytes that belong to no frame.
    pub skipped: u64,
    /// Where the log ends inside a sample, if it does and that was [tolerated](Wt901cReader::tolerate_truncation).
    pub truncated_at: Option<u64>,
}

/// Streams the IMU samples of a log of the module's bytes; memory holds one buffer.
#[derive(Debug)]
pub struct Wt901cReader<R> {
    source: R,
    path: PathBuf,
    parser: Parser,
    assembler: Assembler,
    counts: Wt901cCounts,
    /// End of the last good frame.
    good_until: u64,
    tolerant: bool,
}

impl Wt901cReader<BufReader<File>> {
    /// Opens a log.
    ///
    /// # Errors
    /// [`FormatError::Io`].
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let file = File::open(path).map_err(|cause| FormatError::reading(path, cause))?;
        Ok(Self::new(BufReader::with_capacity(1 << 14, file), path))
    }
}

impl<R: BufRead> Wt901cReader<R> {
    /// Reads from `source`; `path` is named in errors.
    pub fn new(source: R, path: &Path) -> Self {
        Self {
            source,
            path: path.to_owned(),
            parser: Parser::default(),
            assembler: Assembler::default(),
            counts: Wt901cCounts::default(),
            good_until: 0,
            tolerant: false,
        }
    }

    /// Whether a log that ends inside a sample (a logger that was killed) simply ends before it.
    #[must_use]
    pub fn tolerate_truncation(mut self, tolerant: bool) -> Self {
        self.tolerant = tolerant;
        self
    }

    /// The next whole sample, `None` at the end of the log.
    ///
    /// # Errors
    /// [`FormatError::Malformed`] for a log that holds no sample at all or ends inside one, and after 4096 bytes without
    /// a frame; [`FormatError::Io`].
    pub fn next_sample(&mut self) -> Result<Option<RawSample>, FormatError> {
        loop {
            let bytes = match self.source.fill_buf() {
                Ok(bytes) => bytes,
                Err(cause) if cause.kind() == std::io::ErrorKind::Interrupted => continue,
                Err(cause) => return Err(FormatError::reading(&self.path, cause)),
            };
            if bytes.is_empty() {
                return self.end().map(|()| None);
            }
            let (mut used, mut sample) = (0, None);
            for byte in bytes {
                used += 1;
                if let Some(frame) = self.parser.push(*byte) {
                    self.counts.frames += 1;
                    self.good_until = frame.offset + FRAME_BYTES as u64;
                    sample = self.assembler.push(&frame);
                }
                if sample.is_some() || self.parser.offset() - self.good_until > MAX_JUNK {
                    break;
                }
            }
            self.source.consume(used);
            self.counts.bytes += used as u64;
            if let Some(sample) = sample {
                self.counts.samples += 1;
                return Ok(Some(sample));
            }
            if self.parser.offset() - self.good_until > MAX_JUNK {
                let cause = format!("no WT901C frame (0x55, id 0x50 to 0x5f, sum) in {MAX_JUNK} bytes");
                return Err(self.refused(
                    self.good_until,
                    cause,
                    "give the bytes as the sensor's serial port sent them",
                ));
            }
        }
    }

    /// What came by so far.
    pub fn counts(&self) -> Wt901cCounts {
        Wt901cCounts {
            incomplete: self.assembler.incomplete(),
            skipped: self.parser.skipped(),
            ..self.counts
        }
    }

    fn end(&mut self) -> Result<(), FormatError> {
        let Wt901cCounts { bytes, samples, .. } = self.counts;
        if samples == 0 {
            let cause = if bytes == 0 {
                "the file is empty".to_owned()
            } else {
                format!("{bytes} bytes hold no pair of frames 0x51 (accelerometer) and 0x52 (gyroscope)")
            };
            return Err(self.refused(0, cause, "set the sensor's output (RSW) to both and record again"));
        }
        if self.parser.pending() == 0 && !self.assembler.pending() {
            return Ok(());
        }
        if self.tolerant {
            self.counts.truncated_at = Some(self.parser.offset());
            return Ok(());
        }
        let cause = format!("the log ends inside a sample ({bytes} bytes in all)");
        let remedy = "copy it again, or use what is before with --allow-truncated";
        Err(self.refused(self.parser.offset(), cause, remedy))
    }

    fn refused(&self, offset: u64, cause: String, remedy: &str) -> FormatError {
        FormatError::malformed(&self.path, offset, cause, remedy)
    }
}

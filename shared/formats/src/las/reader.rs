//! Points one by one out of a LAS or LAZ file.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use super::header::{Header, u16_at, u32_at};
use super::laz::Unpacker;
use crate::FormatError;
use crate::cloud::{CloudPoint, Origin, relative};

const CUT: &str = "the file was cut or damaged: copy or write it again";

/// Streams the points of a LAS or LAZ file in file order.
///
/// Memory is bounded by one point, and for LAZ of formats 6 to 10 by one chunk (50,000 points as a rule). Coordinates are
/// the stored numbers times scale plus offset, less the origin, and only then `f32`. After an error the iterator ends.
pub struct Reader<R: Read + Seek> {
    points: Points<R>,
    header: Header,
    origin: Origin,
    path: std::path::PathBuf,
    record: Vec<u8>,
    next: u64,
    done: bool,
}

enum Points<R: Read + Seek> {
    Plain(R),
    Packed(Unpacker<R>),
}

impl Reader<BufReader<File>> {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// [`FormatError`] where the file cannot be read or its header is none of LAS 1.0 to 1.4.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let file = File::open(path).map_err(|cause| FormatError::reading(path, cause))?;
        Self::new(BufReader::with_capacity(256 * 1024, file), path)
    }
}

impl<R: Read + Seek + Send + Sync + 'static> Reader<R> {
    /// Reads the header from any source; `path` is for messages only.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn new(mut source: R, path: &Path) -> Result<Self, FormatError> {
        let header = Header::read(&mut source, path)?;
        let points = if header.compressed {
            Points::Packed(Unpacker::new(source, &header).map_err(|cause| {
                FormatError::malformed(path, header.data, cause, "write it again as LAS or LAZ 1.4")
            })?)
        } else {
            Points::Plain(source)
        };
        let record = vec![0; usize::from(header.record)];
        Ok(Self { points, header, origin: [0.0; 3], path: path.to_owned(), record, next: 0, done: false })
    }

    /// Takes `origin` off all coordinates.
    pub fn with_origin(self, origin: Origin) -> Self {
        Self { origin, ..self }
    }

    fn read_point(&mut self) -> Result<CloudPoint, FormatError> {
        let read = match &mut self.points {
            Points::Plain(source) => source.read_exact(&mut self.record),
            Points::Packed(unpacker) => unpacker.next_point(&mut self.record),
        };
        if let Err(cause) = read {
            let cause = format!("after {} of {} points: {cause}", self.next, self.header.points);
            let offset = if self.header.compressed {
                self.header.data
            } else {
                self.header.data + self.next * u64::from(self.header.record)
            };
            return Err(FormatError::malformed(&self.path, offset, cause, CUT));
        }
        let Header { scale, offset, .. } = &self.header;
        let [x, y, z] = [0, 1, 2].map(|axis: usize| {
            let stored = f64::from(u32_at(&self.record, 4 * axis) as i32);
            relative(stored * scale[axis] + offset[axis], self.origin[axis])
        });
        Ok(CloudPoint { x, y, z, intensity: f32::from(u16_at(&self.record, 12)) })
    }
}

impl<R: Read + Seek> Reader<R> {
    /// What the header says.
    pub fn header(&self) -> &Header {
        &self.header
    }
}

impl<R: Read + Seek + Send + Sync + 'static> Iterator for Reader<R> {
    type Item = Result<CloudPoint, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.done || self.next == self.header.points {
            return None;
        }
        let point = self.read_point();
        self.done = point.is_err();
        self.next += 1;
        Some(point)
    }
}

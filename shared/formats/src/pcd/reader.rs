//! Points one by one out of a PCD file.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use super::header::{Encoding, Field, Header, Scalar};
use super::lzf;
use crate::FormatError;
use crate::cloud::{CloudPoint, Origin, relative, relative_word};
use crate::lines::Lines;

const CUT: &str = "the file was cut: copy or write it again";

/// Streams the points of a PCD file in file order.
///
/// Memory is bounded by one point for ascii and binary files; a compressed file stores its columns one after another
/// and is held whole. Points with NaN or infinite coordinates are passed on: see [`CloudPoint::is_finite`]. Bytes after
/// the last point of a binary file are ignored, as other readers do. After an error the iterator ends.
pub struct Reader<R> {
    lines: Lines<R>,
    header: Header,
    columns: [Option<Field>; 4],
    origin: Origin,
    record: Vec<u8>,
    unpacked: Vec<u8>,
    next: u64,
    offset: u64,
    done: bool,
}

impl Reader<BufReader<File>> {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// [`FormatError`] where the file cannot be read or its header is not one of PCD v0.7 with x, y and z.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let file = File::open(path).map_err(|cause| FormatError::reading(path, cause))?;
        Self::new(BufReader::with_capacity(256 * 1024, file), path)
    }
}

impl<R: BufRead> Reader<R> {
    /// Reads the header from any source; `path` is for messages only.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn new(source: R, path: &Path) -> Result<Self, FormatError> {
        let mut lines = Lines::new(source, path);
        let header = Header::read(&mut lines)?;
        let columns = ["x", "y", "z", "intensity"].map(|name| header.field(name).cloned());
        let record = vec![0; header.record];
        let offset = lines.offset();
        let mut reader = Self {
            lines,
            header,
            columns,
            origin: [0.0; 3],
            record,
            unpacked: Vec::new(),
            next: 0,
            offset,
            done: false,
        };
        if reader.header.encoding == Encoding::BinaryCompressed && reader.header.points > 0 {
            reader.unpack()?;
        }
        Ok(reader)
    }

    /// Takes `origin` off all coordinates.
    pub fn with_origin(self, origin: Origin) -> Self {
        Self { origin, ..self }
    }

    /// What the header says.
    pub fn header(&self) -> &Header {
        &self.header
    }

    fn malformed(&self, offset: u64, cause: impl Into<String>, remedy: &str) -> FormatError {
        FormatError::malformed(self.lines.path(), offset, cause, remedy)
    }

    fn cut(&self) -> FormatError {
        let cause = format!("the data end after {} of {} points", self.next, self.header.points);
        self.malformed(self.offset, cause, CUT)
    }

    fn read_point(&mut self) -> Result<CloudPoint, FormatError> {
        match self.header.encoding {
            Encoding::Ascii => self.read_line(),
            Encoding::Binary => self.read_record(),
            Encoding::BinaryCompressed => Ok(self.unpacked_point()),
        }
    }

    fn read_record(&mut self) -> Result<CloudPoint, FormatError> {
        if let Err(cause) = self.lines.source().read_exact(&mut self.record) {
            return Err(match cause.kind() {
                std::io::ErrorKind::UnexpectedEof => self.cut(),
                _ => FormatError::reading(self.lines.path(), cause),
            });
        }
        self.offset += self.record.len() as u64;
        let record = &self.record;
        Ok(point(&self.columns, &self.origin, |field| {
            value(field, record.get(field.offset..).unwrap_or_default())
        }))
    }

    fn read_line(&mut self) -> Result<CloudPoint, FormatError> {
        let (columns, origin, wanted) = (&self.columns, &self.origin, self.header.columns());
        while let Some(line) = self.lines.next_line()? {
            if line.text.trim_ascii().is_empty() {
                continue;
            }
            let parsed = parse_line(columns, origin, wanted, line.text);
            let start = line.start;
            return parsed.map_err(|cause| self.malformed(start, cause, "correct this line"));
        }
        self.offset = self.lines.offset();
        Err(self.cut())
    }

    /// After the last line of an ascii cloud there must be no further point.
    fn check_end(&mut self) -> Option<FormatError> {
        if self.header.encoding != Encoding::Ascii {
            return None;
        }
        loop {
            match self.lines.next_line() {
                Ok(None) => return None,
                Ok(Some(line)) if line.text.trim_ascii().is_empty() => {}
                Ok(Some(line)) => {
                    let start = line.start;
                    let cause = format!("more lines than the {} points of the header", self.header.points);
                    return Some(self.malformed(start, cause, "correct POINTS, WIDTH and HEIGHT"));
                }
                Err(error) => return Some(error),
            }
        }
    }

    fn unpack(&mut self) -> Result<(), FormatError> {
        let mut sizes = [0; 8];
        let sizes_read = self.lines.source().read_exact(&mut sizes);
        sizes_read
            .map_err(|_| self.malformed(self.offset, "the sizes of the compressed data are missing", CUT))?;
        let [a, b, c, d, e, f, g, h] = sizes;
        let (packed, unpacked) = (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h]));
        let expected = self.header.points.checked_mul(self.header.record as u64);
        if expected != Some(u64::from(unpacked))
            || u64::from(unpacked) > u64::from(packed) * lzf::LARGEST_RATIO
        {
            let cause = format!(
                "{packed} compressed and {unpacked} plain bytes do not fit {} points of {} bytes",
                self.header.points, self.header.record
            );
            return Err(self.malformed(self.offset, cause, CUT));
        }
        self.offset += 8;
        let mut data = Vec::new();
        let read = self.lines.source().by_ref().take(u64::from(packed)).read_to_end(&mut data);
        let read = read.map_err(|cause| FormatError::reading(self.lines.path(), cause))?;
        if read < packed as usize {
            let cause = format!("{read} of {packed} compressed bytes are there");
            return Err(self.malformed(self.offset + read as u64, cause, CUT));
        }
        self.unpacked = lzf::decompress(&data, unpacked as usize)
            .map_err(|fault| self.malformed(self.offset + fault.at as u64, fault.cause, CUT))?;
        Ok(())
    }

    /// Compressed data hold all values of the first field, then all of the second, and so on.
    fn unpacked_point(&self) -> CloudPoint {
        let points = self.header.points as usize;
        point(&self.columns, &self.origin, |field| {
            let at = field.offset * points + self.next as usize * field.size;
            value(field, self.unpacked.get(at..).unwrap_or_default())
        })
    }
}

impl<R: BufRead> Iterator for Reader<R> {
    type Item = Result<CloudPoint, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.done {
            return None;
        }
        if self.next == self.header.points {
            self.done = true;
            return self.check_end().map(Err);
        }
        let point = self.read_point();
        self.done = point.is_err();
        self.next += 1;
        Some(point)
    }
}

fn point(columns: &[Option<Field>; 4], origin: &Origin, value: impl Fn(&Field) -> f64) -> CloudPoint {
    let [x, y, z, intensity] = columns.each_ref().map(|field| field.as_ref().map_or(0.0, &value));
    CloudPoint {
        x: relative(x, origin[0]),
        y: relative(y, origin[1]),
        z: relative(z, origin[2]),
        intensity: intensity as f32,
    }
}

fn parse_line(
    columns: &[Option<Field>; 4],
    origin: &Origin,
    wanted: usize,
    line: &str,
) -> Result<CloudPoint, String> {
    let [x, y, z] = *origin;
    let mut values = [0.0; 4];
    let mut count = 0;
    for (column, word) in line.split_ascii_whitespace().enumerate() {
        count += 1;
        for ((value, origin), field) in values.iter_mut().zip([x, y, z, 0.0]).zip(columns) {
            if field.as_ref().is_some_and(|field| field.column == column) {
                *value = relative_word(word, origin)
                    .ok_or_else(|| format!("{word:?} in column {} is no number", column + 1))?;
            }
        }
    }
    if count != wanted {
        return Err(format!("{count} values where the header's fields need {wanted}"));
    }
    let [x, y, z, intensity] = values;
    Ok(CloudPoint { x, y, z, intensity })
}

/// The value at the start of `bytes`; 0 where they are too short, which the sizes checked before exclude.
fn value(field: &Field, bytes: &[u8]) -> f64 {
    fn head<const N: usize>(bytes: &[u8]) -> [u8; N] {
        bytes.first_chunk().copied().unwrap_or([0; N])
    }
    match (field.scalar, field.size) {
        (Scalar::Float, 4) => f64::from(f32::from_le_bytes(head(bytes))),
        (Scalar::Float, _) => f64::from_le_bytes(head(bytes)),
        (Scalar::Signed, 1) => f64::from(i8::from_le_bytes(head(bytes))),
        (Scalar::Signed, 2) => f64::from(i16::from_le_bytes(head(bytes))),
        (Scalar::Signed, 4) => f64::from(i32::from_le_bytes(head(bytes))),
        (Scalar::Signed, _) => i64::from_le_bytes(head(bytes)) as f64,
        (Scalar::Unsigned, 1) => f64::from(u8::from_le_bytes(head(bytes))),
        (Scalar::Unsigned, 2) => f64::from(u16::from_le_bytes(head(bytes))),
        (Scalar::Unsigned, 4) => f64::from(u32::from_le_bytes(head(bytes))),
        (Scalar::Unsigned, _) => u64::from_le_bytes(head(bytes)) as f64,
    }
}

//! Vertices one by one out of a PLY file.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use super::header::{Element, Encoding, Header, Property};
use crate::FormatError;
use crate::cloud::{CloudPoint, Origin, relative, relative_word};
use crate::lines::Lines;

const CUT: &str = "the file was cut: copy or write it again";
/// Bytes of one vertex without its lists; real files have up to some hundred.
const LARGEST_RECORD: usize = 64 * 1024;

/// Streams the vertices of a PLY file in file order; other elements before them are passed over, those behind are not
/// read. Memory is bounded by one vertex. Points with NaN or infinite coordinates are passed on: see
/// [`CloudPoint::is_finite`]. After an error the iterator ends.
pub struct Reader<R> {
    lines: Lines<R>,
    encoding: Encoding,
    vertex: Element,
    /// Which property is x, y, z and the intensity.
    columns: [Option<usize>; 4],
    /// Where each column lies in a record, of vertices without lists.
    places: Option<[usize; 4]>,
    record: Vec<u8>,
    origin: Origin,
    next: u64,
    offset: u64,
    done: bool,
}

impl Reader<BufReader<File>> {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// [`FormatError`] where the file cannot be read or its header is not one of PLY 1.0 with x, y and z.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let file = File::open(path).map_err(|cause| FormatError::reading(path, cause))?;
        Self::new(BufReader::with_capacity(256 * 1024, file), path)
    }
}

impl<R: BufRead> Reader<R> {
    /// Reads the header from any source, and passes over what lies before the vertices; `path` is for messages only.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn new(source: R, path: &Path) -> Result<Self, FormatError> {
        let mut lines = Lines::new(source, path);
        let Header { encoding, elements } = Header::read(&mut lines)?;
        let offset = lines.offset();
        let refuse = |cause: &str| {
            Err(FormatError::malformed(path, offset, cause, "give a PLY file of points with x, y and z"))
        };
        let Some(at) = elements.iter().position(|element| element.name == "vertex") else {
            return refuse("there is no element \"vertex\"");
        };
        let mut elements = elements.into_iter();
        let before: Vec<_> = elements.by_ref().take(at).collect();
        let Some(vertex) = elements.next() else { return refuse("there is no element \"vertex\"") };
        let columns = columns(&vertex.properties);
        if columns.iter().take(3).any(Option::is_none) {
            return refuse("its vertices have no x, y and z");
        }
        let size: usize = vertex.properties.iter().map(|property| property.number.bytes()).sum();
        if size > LARGEST_RECORD {
            return refuse("one vertex takes more than 65536 bytes");
        }
        let places = vertex.properties.iter().all(|property| property.list.is_none()).then(|| {
            columns.map(|column| {
                let before = vertex.properties.iter().take(column.unwrap_or(0));
                before.map(|property| property.number.bytes()).sum()
            })
        });
        let mut reader = Self {
            lines,
            encoding,
            vertex,
            columns,
            places,
            record: vec![0; size],
            origin: [0.0; 3],
            next: 0,
            offset,
            done: false,
        };
        before.iter().try_for_each(|element| reader.pass_over(element))?;
        Ok(reader)
    }

    /// Takes `origin` off all coordinates.
    pub fn with_origin(self, origin: Origin) -> Self {
        Self { origin, ..self }
    }

    /// Vertices that the header announces.
    pub fn points(&self) -> u64 {
        self.vertex.count
    }

    fn pass_over(&mut self, element: &Element) -> Result<(), FormatError> {
        for _ in 0..element.count {
            match self.encoding {
                Encoding::Ascii => {
                    self.next_row()?;
                }
                // What takes no bytes can be passed over at once, however often.
                _ if element.properties.is_empty() => break,
                _ => self.read_values(&element.properties, |_, _| ())?,
            }
        }
        Ok(())
    }

    fn read_point(&mut self) -> Result<CloudPoint, FormatError> {
        let mut values = [0.0; 4];
        let big_endian = self.encoding == Encoding::BigEndian;
        if self.encoding == Encoding::Ascii {
            return self.read_row();
        } else if let Some(places) = self.places {
            if let Err(cause) = self.lines.source().read_exact(&mut self.record) {
                return Err(self.failed(cause));
            }
            self.offset += self.record.len() as u64;
            for ((value, column), at) in values.iter_mut().zip(self.columns).zip(places) {
                if let Some(property) = column.and_then(|column| self.vertex.properties.get(column)) {
                    *value = property.number.value(self.record.get(at..).unwrap_or_default(), big_endian);
                }
            }
        } else {
            let (columns, properties) = (self.columns, std::mem::take(&mut self.vertex.properties));
            let read = self.read_values(&properties, |index, number| {
                for (value, _) in values.iter_mut().zip(columns).filter(|(_, column)| *column == Some(index))
                {
                    *value = number;
                }
            });
            self.vertex.properties = properties;
            read?;
        }
        let [x, y, z, intensity] = values;
        let [ox, oy, oz] = self.origin;
        Ok(CloudPoint {
            x: relative(x, ox),
            y: relative(y, oy),
            z: relative(z, oz),
            intensity: intensity as f32,
        })
    }

    /// Reads one binary element with lists; `take` gets the single values.
    fn read_values(
        &mut self,
        properties: &[Property],
        mut take: impl FnMut(usize, f64),
    ) -> Result<(), FormatError> {
        let big_endian = self.encoding == Encoding::BigEndian;
        for (index, property) in properties.iter().enumerate() {
            let number = property.list.unwrap_or(property.number);
            let mut raw = [0; 8];
            let bytes = raw.get_mut(..number.bytes()).unwrap_or_default();
            if let Err(cause) = self.lines.source().read_exact(bytes) {
                return Err(self.failed(cause));
            }
            self.offset += number.bytes() as u64;
            let value = number.value(&raw, big_endian);
            if property.list.is_none() {
                take(index, value);
            } else if value < 0.0 {
                let cause = format!("a list of {value} values");
                return Err(FormatError::malformed(self.lines.path(), self.offset, cause, CUT));
            } else {
                self.skip(value as u64 * property.number.bytes() as u64)?;
            }
        }
        Ok(())
    }

    fn skip(&mut self, bytes: u64) -> Result<(), FormatError> {
        match io::copy(&mut self.lines.source().by_ref().take(bytes), &mut io::sink()) {
            Ok(skipped) if skipped == bytes => {
                self.offset += bytes;
                Ok(())
            }
            Ok(_) => Err(self.failed(io::ErrorKind::UnexpectedEof.into())),
            Err(cause) => Err(self.failed(cause)),
        }
    }

    /// The next line that is not empty.
    fn next_row(&mut self) -> Result<(u64, &str), FormatError> {
        let (path, next, count) = (self.lines.path().to_owned(), self.next, self.vertex.count);
        let end = self.lines.offset();
        let mut found = None;
        while found.is_none() {
            let Some(line) = self.lines.next_line()? else {
                let cause = format!("the data end after {next} of {count} vertices");
                return Err(FormatError::malformed(&path, end, cause, CUT));
            };
            if !line.text.trim_ascii().is_empty() {
                self.record.clear();
                self.record.extend_from_slice(line.text.as_bytes());
                found = Some(line.start);
            }
        }
        Ok((found.unwrap_or(end), std::str::from_utf8(&self.record).unwrap_or_default()))
    }

    fn read_row(&mut self) -> Result<CloudPoint, FormatError> {
        let (columns, [x, y, z]) = (self.columns, self.origin);
        let properties = std::mem::take(&mut self.vertex.properties);
        let row = self.next_row();
        let parsed = row.map(|(start, text)| (start, parse(text, &properties, columns, [x, y, z, 0.0])));
        self.vertex.properties = properties;
        let (start, point) = parsed?;
        point.map_err(|cause| FormatError::malformed(self.lines.path(), start, cause, "correct this line"))
    }

    fn failed(&self, cause: io::Error) -> FormatError {
        if cause.kind() != io::ErrorKind::UnexpectedEof {
            return FormatError::reading(self.lines.path(), cause);
        }
        let cause = format!("the data end after {} of {} vertices", self.next, self.vertex.count);
        FormatError::malformed(self.lines.path(), self.offset, cause, CUT)
    }
}

impl<R: BufRead> Iterator for Reader<R> {
    type Item = Result<CloudPoint, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.done || self.next == self.vertex.count {
            return None;
        }
        let point = self.read_point();
        self.done = point.is_err();
        self.next += 1;
        Some(point)
    }
}

/// Which properties are x, y, z and the intensity (CloudCompare calls it `scalar_Intensity`).
fn columns(properties: &[Property]) -> [Option<usize>; 4] {
    let find =
        |names: &[&str]| properties.iter().position(|p| p.list.is_none() && names.contains(&p.name.as_str()));
    [find(&["x"]), find(&["y"]), find(&["z"]), find(&["intensity", "scalar_Intensity", "scalar_intensity"])]
}

/// A line of an ascii file; lists are passed over by their lengths.
fn parse(
    line: &str,
    properties: &[Property],
    columns: [Option<usize>; 4],
    origin: [f64; 4],
) -> Result<CloudPoint, String> {
    let mut words = line.split_ascii_whitespace();
    let mut values = [0.0; 4];
    for (index, property) in properties.iter().enumerate() {
        let word = words.next().ok_or_else(|| format!("no value for property {:?}", property.name))?;
        let bad = || format!("{word:?} for property {:?} is no number", property.name);
        if property.list.is_some() {
            let length: usize = word.parse().map_err(|_| bad())?;
            if length > 0 && words.nth(length - 1).is_none() {
                return Err(format!("the list {:?} is shorter than its length", property.name));
            }
            continue;
        }
        for ((value, column), origin) in values.iter_mut().zip(columns).zip(origin) {
            if column == Some(index) {
                *value = relative_word(word, origin).ok_or_else(bad)?;
            }
        }
    }
    match words.next() {
        None => {
            let [x, y, z, intensity] = values;
            Ok(CloudPoint { x, y, z, intensity })
        }
        Some(word) => Err(format!("{word:?} behind the last property")),
    }
}

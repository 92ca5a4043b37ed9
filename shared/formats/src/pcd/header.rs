//! The text at the start of a PCD file.

use std::io::BufRead;

use crate::FormatError;
use crate::lines::{Line, Lines};

/// Bytes of one point; real files have up to some hundred.
const LARGEST_RECORD: usize = 64 * 1024;

/// How the points follow the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// One line a point.
    Ascii,
    /// One packed little-endian record a point.
    Binary,
    /// LZF-compressed, field after field.
    BinaryCompressed,
}

/// Type of a field's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scalar {
    /// `TYPE I`.
    Signed,
    /// `TYPE U`.
    Unsigned,
    /// `TYPE F`.
    Float,
}

/// One entry of `FIELDS` with its `SIZE`, `TYPE` and `COUNT`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Name; `_` is padding.
    pub name: String,
    /// Bytes of one value.
    pub size: usize,
    /// Type of a value.
    pub scalar: Scalar,
    /// Values in one point.
    pub count: usize,
    /// Bytes from the start of the record.
    pub offset: usize,
    /// Values of one point that stand before this field's (columns of an ascii line).
    pub column: usize,
}

/// What a PCD header says. `VIEWPOINT` is where the sensor stood; it does not move the points and is not kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    /// Fields in file order.
    pub fields: Vec<Field>,
    /// Number of points.
    pub points: u64,
    /// How they follow.
    pub encoding: Encoding,
    /// Bytes of one point in binary form.
    pub record: usize,
}

impl Header {
    /// The field of this name.
    pub fn field(&self, name: &str) -> Option<&Field> {
        self.fields.iter().find(|field| field.name == name)
    }

    /// Values of one point, all fields together: columns of an ascii line.
    pub(super) fn columns(&self) -> usize {
        self.fields.last().map_or(0, |last| last.column + last.count)
    }

    /// Reads up to and including the `DATA` line.
    pub(super) fn read<R: BufRead>(lines: &mut Lines<R>) -> Result<Self, FormatError> {
        let path = lines.path().to_owned();
        let fault = |line: &Line<'_>, cause: String| {
            FormatError::malformed(&path, line.start, cause, "write the cloud again as PCD v0.7")
        };
        let mut entries = Entries::default();
        while let Some(line) = lines.next_line()? {
            if entries.take(line.text).map_err(|cause| fault(&line, cause))? {
                return entries.into_header().map_err(|cause| fault(&line, cause));
            }
        }
        let cause = "the file ends before the DATA line of a PCD header";
        Err(FormatError::malformed(&path, lines.offset(), cause, "check that this is a whole PCD file"))
    }
}

#[derive(Default)]
struct Entries {
    names: Vec<String>,
    sizes: Vec<usize>,
    scalars: Vec<Scalar>,
    counts: Option<Vec<usize>>,
    width: Option<u64>,
    height: Option<u64>,
    points: Option<u64>,
    encoding: Option<Encoding>,
}

impl Entries {
    /// Takes one line; true when it was the last of the header.
    fn take(&mut self, line: &str) -> Result<bool, String> {
        let mut words = line.split_ascii_whitespace();
        let Some(keyword) = words.next().filter(|word| !word.starts_with('#')) else { return Ok(false) };
        match keyword {
            "VERSION" => match words.next() {
                Some("0.7" | ".7" | "0.6" | ".6") => {}
                other => return Err(format!("version {:?} where 0.7 is supported", other.unwrap_or(""))),
            },
            "FIELDS" | "COLUMNS" => self.names = words.map(str::to_owned).collect(),
            "SIZE" => self.sizes = words.map(number).collect::<Result<_, _>>()?,
            "TYPE" => self.scalars = words.map(scalar).collect::<Result<_, _>>()?,
            "COUNT" => self.counts = Some(words.map(number).collect::<Result<_, _>>()?),
            "WIDTH" => self.width = Some(number(words.next().unwrap_or(""))?),
            "HEIGHT" => self.height = Some(number(words.next().unwrap_or(""))?),
            "POINTS" => self.points = Some(number(words.next().unwrap_or(""))?),
            "VIEWPOINT" => {}
            "DATA" => {
                self.encoding = Some(encoding(words.next().unwrap_or(""))?);
                return Ok(true);
            }
            other => return Err(format!("{other:?} is no keyword of a PCD header")),
        }
        Ok(false)
    }

    fn into_header(self) -> Result<Header, String> {
        let n = self.names.len();
        let counts = self.counts.unwrap_or_else(|| vec![1; n]);
        if self.sizes.len() != n || self.scalars.len() != n || counts.len() != n {
            return Err(format!(
                "{n} FIELDS but {} SIZE, {} TYPE and {} COUNT entries",
                self.sizes.len(),
                self.scalars.len(),
                counts.len()
            ));
        }
        let mut fields: Vec<Field> = Vec::with_capacity(n);
        let (mut offset, mut column) = (0usize, 0usize);
        for (((name, size), scalar), count) in
            self.names.into_iter().zip(self.sizes).zip(self.scalars).zip(counts)
        {
            let sizes: &[usize] = if scalar == Scalar::Float { &[4, 8] } else { &[1, 2, 4, 8] };
            if !sizes.contains(&size) {
                return Err(format!(
                    "field {name:?} has SIZE {size} where {sizes:?} are possible for its TYPE"
                ));
            }
            if matches!(name.as_str(), "x" | "y" | "z" | "intensity") {
                if fields.iter().any(|other| other.name == name) {
                    return Err(format!("field {name:?} appears twice"));
                }
                if count != 1 {
                    return Err(format!("field {name:?} has COUNT {count} where 1 is needed"));
                }
            }
            let end = size.checked_mul(count).and_then(|bytes| offset.checked_add(bytes));
            let Some(end) = end.filter(|end| *end <= LARGEST_RECORD) else {
                return Err(format!("one point takes more than {LARGEST_RECORD} bytes"));
            };
            fields.push(Field { name, size, scalar, count, offset, column });
            offset = end;
            column += count;
        }
        if let Some(missing) = ["x", "y", "z"].iter().find(|axis| !fields.iter().any(|f| f.name == **axis)) {
            return Err(format!("there is no field {missing:?}"));
        }
        let points = points(self.points, self.width, self.height)?;
        let Some(encoding) = self.encoding else { return Err("there is no DATA line".to_owned()) };
        Ok(Header { fields, points, encoding, record: offset })
    }
}

fn points(points: Option<u64>, width: Option<u64>, height: Option<u64>) -> Result<u64, String> {
    let area = match (width, height) {
        (Some(w), Some(h)) => {
            Some(w.checked_mul(h).ok_or_else(|| format!("WIDTH {w} times HEIGHT {h} is beyond 64 bits"))?)
        }
        _ => None,
    };
    match (points, area) {
        (Some(points), Some(area)) if points != area => {
            Err(format!("POINTS {points} is not WIDTH times HEIGHT, {area}"))
        }
        (Some(points), _) | (None, Some(points)) => Ok(points),
        (None, None) => Err("neither POINTS nor WIDTH and HEIGHT are there".to_owned()),
    }
}

fn number<T: std::str::FromStr>(word: &str) -> Result<T, String> {
    word.parse().map_err(|_| format!("{word:?} where a whole number is needed"))
}

fn scalar(word: &str) -> Result<Scalar, String> {
    match word {
        "I" | "i" => Ok(Scalar::Signed),
        "U" | "u" => Ok(Scalar::Unsigned),
        "F" | "f" => Ok(Scalar::Float),
        _ => Err(format!("TYPE {word:?} where I, U and F are possible")),
    }
}

fn encoding(word: &str) -> Result<Encoding, String> {
    match word {
        "ascii" => Ok(Encoding::Ascii),
        "binary" => Ok(Encoding::Binary),
        "binary_compressed" => Ok(Encoding::BinaryCompressed),
        _ => Err(format!("DATA {word:?} where ascii, binary and binary_compressed are possible")),
    }
}

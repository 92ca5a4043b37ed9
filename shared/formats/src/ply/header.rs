//! The text at the start of a PLY file.

use std::io::BufRead;

use crate::FormatError;
use crate::lines::Lines;

/// Most lines of a header, comments included; a header without end is refused there.
const MOST_LINES: usize = 10_000;

/// How the elements follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Number {
    fn named(word: &str) -> Result<Self, String> {
        Ok(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            other => return Err(format!("{other:?} is no type of a PLY property")),
        })
    }

    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The value of exactly [`Self::bytes`] bytes, 0 of fewer.
    pub(super) fn value(self, bytes: &[u8], big_endian: bool) -> f64 {
        let mut raw = [0; 8];
        if let (Some(to), Some(from)) = (raw.get_mut(..self.bytes()), bytes.get(..self.bytes())) {
            to.copy_from_slice(from);
            if big_endian {
                to.reverse();
            }
        }
        let [a, b, c, d, ..] = raw;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(raw),
        }
    }
}

/// One `property` of an element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) number: Number,
    /// Of a list: the type of its length.
    pub(super) list: Option<Number>,
}

/// One `element`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

/// What the header says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
}

impl Header {
    /// Reads up to and including `end_header`.
    pub(super) fn read<R: BufRead>(lines: &mut Lines<R>) -> Result<Self, FormatError> {
        let path = lines.path().to_owned();
        let remedy = "write the cloud again as PLY 1.0 with x, y and z of its vertices";
        let mut encoding = None;
        let mut elements = Vec::new();
        for number in 0..MOST_LINES {
            let Some(line) = lines.next_line()? else { break };
            let start = line.start;
            let fault = |cause: String| FormatError::malformed(&path, start, cause, remedy);
            match take(line.text, number, &mut encoding, &mut elements).map_err(fault)? {
                Taken::More => {}
                Taken::End => {
                    let none = || fault("there is no format line".to_owned());
                    return Ok(Self { encoding: encoding.ok_or_else(none)?, elements });
                }
            }
        }
        let cause = "there is no end_header where a PLY header must have one";
        Err(FormatError::malformed(&path, lines.offset(), cause, "check that this is a whole PLY file"))
    }
}

enum Taken {
    More,
    End,
}

fn take(
    line: &str,
    number: usize,
    encoding: &mut Option<Encoding>,
    elements: &mut Vec<Element>,
) -> Result<Taken, String> {
    let mut words = line.split_ascii_whitespace();
    let mut next = || words.next().unwrap_or("");
    match next() {
        "ply" if number == 0 => {}
        other if number == 0 => return Err(format!("{other:?} where a PLY file begins with \"ply\"")),
        "" | "comment" | "obj_info" => {}
        "end_header" => return Ok(Taken::End),
        "format" => {
            *encoding = Some(match next() {
                "ascii" => Encoding::Ascii,
                "binary_little_endian" => Encoding::LittleEndian,
                "binary_big_endian" => Encoding::BigEndian,
                other => return Err(format!("format {other:?} is not one of PLY")),
            });
            match next() {
                "1.0" => {}
                other => return Err(format!("version {other:?} where 1.0 is supported")),
            }
        }
        "element" => {
            let (name, count) = (next().to_owned(), next());
            let count =
                count.parse().map_err(|_| format!("{count:?} where a number of elements is needed"))?;
            elements.push(Element { name, count, properties: Vec::new() });
        }
        "property" => {
            let Some(element) = elements.last_mut() else {
                return Err("a property before the first element".to_owned());
            };
            let property = match next() {
                "list" => {
                    let list = Number::named(next())?;
                    if matches!(list, Number::F32 | Number::F64) {
                        return Err("the length of a list is no whole number".to_owned());
                    }
                    Property { list: Some(list), number: Number::named(next())?, name: next().to_owned() }
                }
                word => Property { list: None, number: Number::named(word)?, name: next().to_owned() },
            };
            element.properties.push(property);
        }
        other => return Err(format!("{other:?} is no keyword of a PLY header")),
    }
    Ok(Taken::More)
}

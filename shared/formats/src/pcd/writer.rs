//! PCD files as ascii and binary.

use std::io::{self, Write};
use std::path::Path;

use crate::cloud::{CloudPoint, Intensity};
use crate::{FormatError, write_atomically};

/// How points are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WriteAs {
    /// One line a point, each value with as many digits as bring the same `f32` back.
    Ascii,
    /// Packed little-endian `f32`.
    Binary,
}

/// Writes a file whole or not at all.
///
/// # Errors
/// [`FormatError::Io`] naming `path`.
pub fn write(
    path: &Path,
    points: impl ExactSizeIterator<Item = CloudPoint>,
    intensity: Intensity,
    write_as: WriteAs,
) -> Result<(), FormatError> {
    write_atomically(path, |writer| write_to(writer, points, intensity, write_as))
}

/// Writes to any sink. The header is the one PCL writes.
///
/// # Errors
/// Those of the sink.
pub fn write_to(
    writer: &mut impl Write,
    points: impl ExactSizeIterator<Item = CloudPoint>,
    intensity: Intensity,
    write_as: WriteAs,
) -> io::Result<()> {
    let (fields, columns) = match intensity {
        Intensity::Kept => ("x y z intensity", 4),
        Intensity::Dropped => ("x y z", 3),
    };
    let each = |word: &str| vec![word; columns].join(" ");
    let data = match write_as {
        WriteAs::Ascii => "ascii",
        WriteAs::Binary => "binary",
    };
    let n = points.len();
    writeln!(writer, "# .PCD v0.7 - Point Cloud Data file format")?;
    writeln!(writer, "VERSION 0.7\nFIELDS {fields}\nSIZE {}\nTYPE {}", each("4"), each("F"))?;
    writeln!(writer, "COUNT {}\nWIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0", each("1"))?;
    writeln!(writer, "POINTS {n}\nDATA {data}")?;
    for point in points {
        let values = [point.x, point.y, point.z, point.intensity];
        let values = values.get(..columns).unwrap_or_default();
        match write_as {
            WriteAs::Ascii => write_line(writer, values)?,
            WriteAs::Binary => {
                for value in values {
                    writer.write_all(&value.to_le_bytes())?;
                }
            }
        }
    }
    Ok(())
}

fn write_line(writer: &mut impl Write, values: &[f32]) -> io::Result<()> {
    for (i, value) in values.iter().enumerate() {
        let space = if i == 0 { "" } else { " " };
        // PCL reads and writes "nan" in lower case.
        if value.is_nan() {
            write!(writer, "{space}nan")?;
        } else {
            write!(writer, "{space}{value}")?;
        }
    }
    writeln!(writer)
}

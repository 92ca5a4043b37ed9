//! Point clouds as binary little endian.

use std::io::{self, Write};
use std::path::Path;

use crate::cloud::{CloudPoint, Intensity};
use crate::{FormatError, write_atomically};

/// Writes a file whole or not at all.
///
/// # Errors
/// [`FormatError::Io`] naming `path`.
pub fn write(
    path: &Path,
    points: impl ExactSizeIterator<Item = CloudPoint>,
    intensity: Intensity,
) -> Result<(), FormatError> {
    write_atomically(path, |writer| write_to(writer, points, intensity))
}

/// Writes to any sink.
///
/// # Errors
/// Those of the sink.
pub fn write_to(
    writer: &mut impl Write,
    points: impl ExactSizeIterator<Item = CloudPoint>,
    intensity: Intensity,
) -> io::Result<()> {
    writeln!(writer, "ply\nformat binary_little_endian 1.0\nelement vertex {}", points.len())?;
    writeln!(writer, "property float x\nproperty float y\nproperty float z")?;
    if intensity == Intensity::Kept {
        writeln!(writer, "property float intensity")?;
    }
    writeln!(writer, "end_header")?;
    for point in points {
        for value in [point.x, point.y, point.z] {
            writer.write_all(&value.to_le_bytes())?;
        }
        if intensity == Intensity::Kept {
            writer.write_all(&point.intensity.to_le_bytes())?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_bytes_of_a_cloud_of_one_point() {
        let point = CloudPoint { x: 1.0, y: -2.0, z: 0.5, intensity: 7.0 };
        let mut bytes = Vec::new();
        write_to(&mut bytes, [point].into_iter(), Intensity::Kept).unwrap();
        let header =
            b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
            property float z\nproperty float intensity\nend_header\n";
        let body = [0, 0, 0x80, 0x3f, 0, 0, 0, 0xc0, 0, 0, 0, 0x3f, 0, 0, 0xe0, 0x40];
        assert_eq!(bytes, [header.as_slice(), &body].concat());
    }
}

//! Portable float maps: one 32-bit float a pixel. ImageMagick, GIMP and OpenCV read them; in Python three lines do.
//!
//! `Pf`, width and height, `-1.0` (little endian), then rows from the bottom up: the order of an occupancy grid's rows.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use crate::{FormatError, write_atomically};

const REMEDY: &str = "a grey float map begins with Pf, width and height, and -1.0";

/// Writes rows of `width` pixels from the lowest up, whole or not at all.
///
/// # Errors
/// [`FormatError::Io`] naming `path`; also where the pixels are no whole rows.
pub fn write(path: &Path, width: u32, pixels: &[f32]) -> Result<(), FormatError> {
    write_atomically(path, |writer| {
        let rows = pixels.chunks_exact(width.max(1) as usize);
        if width == 0 || !rows.remainder().is_empty() {
            let cause = format!("{} pixels are no rows of {width}", pixels.len());
            return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, cause));
        }
        write!(writer, "Pf\n{width} {}\n-1.0\n", rows.len())?;
        pixels.iter().try_for_each(|pixel| writer.write_all(&pixel.to_le_bytes()))
    })
}

/// Reads a little-endian grey float map: width, and the pixels from the lowest row up.
///
/// # Errors
/// [`FormatError`] naming the file.
pub fn read(path: &Path) -> Result<(u32, Vec<f32>), FormatError> {
    let bytes = fs::read(path).map_err(|cause| FormatError::reading(path, cause))?;
    let fault = |at: usize, cause: String| FormatError::malformed(path, at as u64, cause, REMEDY);
    let mut lines = bytes.splitn(4, |byte| *byte == b'\n');
    let mut line = || lines.next().and_then(|line| std::str::from_utf8(line).ok()).unwrap_or_default();
    let (magic, size, scale) = (line(), line(), line());
    if magic != "Pf" || scale.parse::<f32>().is_ok_and(|scale| scale >= 0.0) {
        return Err(fault(0, format!("a header of {magic:?}, {size:?} and {scale:?}")));
    }
    let size = size.split_once(' ').and_then(|(w, h)| Some((w.parse::<u32>().ok()?, h.parse::<u32>().ok()?)));
    let (width, height) = size.ok_or_else(|| fault(3, "no width and height".to_owned()))?;
    let data = lines.next().unwrap_or_default();
    let wanted = 4 * u128::from(width) * u128::from(height);
    if data.len() as u128 != wanted || width == 0 {
        let cause = format!("{} bytes where {width} x {height} pixels take {wanted}", data.len());
        return Err(fault(bytes.len() - data.len(), cause));
    }
    let pixels =
        data.chunks_exact(4).filter_map(|chunk| chunk.first_chunk().copied().map(f32::from_le_bytes));
    Ok((width, pixels.collect()))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn golden_bytes_of_two_pixels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pfm");
        write(&path, 2, &[1.0, f32::NAN]).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"Pf\n2 1\n-1.0\n\x00\x00\x80\x3f\x00\x00\xc0\x7f");
        assert!(write(&path, 2, &[1.0; 3]).unwrap_err().to_string().contains("3 pixels"));
    }

    proptest! {
        #[test]
        fn every_map_comes_back(width in 1u32..9, rows in 1usize..9, seed: u32) {
            let pixels: Vec<f32> = (0..width * rows as u32).map(|i| (i ^ seed) as f32 * 0.01).collect();
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.pfm");
            write(&path, width, &pixels).unwrap();
            prop_assert_eq!(read(&path).unwrap(), (width, pixels));
        }

        #[test]
        fn no_bytes_make_the_reader_panic(bytes in proptest::collection::vec(any::<u8>(), 0..60), cut: bool) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.pfm");
            let head: &[u8] = if cut { b"Pf\n3 4294967295\n-1.0\n" } else { b"" };
            fs::write(&path, [head, &bytes].concat()).unwrap();
            let _ = read(&path);
        }
    }
}

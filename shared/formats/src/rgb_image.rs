//! Pictures: an RGB canvas and its PNG file.

use std::io;
use std::path::Path;

use crate::{FormatError, write_atomically};

/// An 8-bit RGB picture, row 0 at the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RgbImage {
    width: u32,
    height: u32,
    bytes: Vec<u8>,
}

impl RgbImage {
    /// A picture of one colour.
    pub fn new(width: u32, height: u32, colour: [u8; 3]) -> Self {
        let bytes = colour.repeat(width as usize * height as usize);
        Self { width, height, bytes }
    }

    /// Pixels along x.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels along y.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The colour at `x` to the right and `y` down; `None` outside.
    pub fn get(&self, x: i64, y: i64) -> Option<[u8; 3]> {
        let at = self.index(x, y)?;
        self.bytes.get(at..at + 3)?.first_chunk().copied()
    }

    /// Colours a pixel; one outside the picture is left out.
    pub fn set(&mut self, x: i64, y: i64, colour: [u8; 3]) {
        if let Some(pixel) = self.index(x, y).and_then(|at| self.bytes.get_mut(at..at + 3)) {
            pixel.copy_from_slice(&colour);
        }
    }

    fn index(&self, x: i64, y: i64) -> Option<usize> {
        let inside = (0..i64::from(self.width)).contains(&x) && (0..i64::from(self.height)).contains(&y);
        inside.then(|| 3 * (y as usize * self.width as usize + x as usize))
    }

    /// Writes a PNG file whole or not at all; the same picture gives the same bytes.
    ///
    /// # Errors
    /// [`FormatError::Io`] naming `path`.
    pub fn write_png(&self, path: &Path) -> Result<(), FormatError> {
        write_atomically(path, |writer| {
            let mut encoder = png::Encoder::new(writer, self.width, self.height);
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_depth(png::BitDepth::Eight);
            encoder.set_compression(png::Compression::Balanced);
            let mut image = encoder.write_header().map_err(io_error)?;
            image.write_image_data(&self.bytes).map_err(io_error)?;
            image.finish().map_err(io_error)
        })
    }
}

fn io_error(error: png::EncodingError) -> io::Error {
    match error {
        png::EncodingError::IoError(cause) => cause,
        other => io::Error::other(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_comes_back_pixel_by_pixel() {
        let mut image = RgbImage::new(3, 2, [255, 255, 255]);
        image.set(2, 1, [1, 2, 3]);
        image.set(-1, 0, [9, 9, 9]);
        image.set(3, 0, [9, 9, 9]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        image.write_png(&path).unwrap();
        let file = std::io::BufReader::new(std::fs::File::open(&path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!((info.width, info.height), (3, 2));
        assert_eq!(bytes, image.bytes);
        assert_eq!(bytes[15..18], [1, 2, 3]);
        assert_eq!(bytes.iter().filter(|b| **b == 255).count(), 15);
    }
}

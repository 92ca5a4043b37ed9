//! Binary PGM (P5, 8 bits), and grey PNG.

use std::io::Cursor;
use std::path::Path;

use crate::FormatError;

const REMEDY: &str = "save the picture as binary 8-bit PGM (P5) or as 8-bit grey PNG";
/// Most pixels of a PNG: more than a plan of 16,384 cells a side never has.
const MAX_PIXELS: u64 = 1 << 28;

/// A grey picture, row 0 at the top.
pub(super) struct GreyImage {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) maximum: u8,
    pub(super) pixels: Vec<u8>,
    /// Empty where all pixels are opaque.
    pub(super) alpha: Vec<u8>,
}

/// Parses a picture of either kind; `path` is for messages only.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<GreyImage, FormatError> {
    if bytes.starts_with(b"\x89PNG") { parse_png(bytes, path) } else { parse_pgm(bytes, path) }
}

/// Parses a PNG file; `path` is for messages only.
fn parse_png(bytes: &[u8], path: &Path) -> Result<GreyImage, FormatError> {
    let fault = |cause: String| FormatError::malformed(path, 0, cause, REMEDY);
    let mut reader =
        png::Decoder::new(Cursor::new(bytes)).read_info().map_err(|error| fault(error.to_string()))?;
    let (width, height) = (reader.info().width, reader.info().height);
    let channels = match reader.output_color_type() {
        (png::ColorType::Grayscale, png::BitDepth::Eight) => 1,
        (png::ColorType::GrayscaleAlpha, png::BitDepth::Eight) => 2,
        (colour, depth) => return Err(fault(format!("a PNG of {colour:?} with {depth:?} bits"))),
    };
    let pixels = u64::from(width) * u64::from(height);
    let size = reader.output_buffer_size().filter(|_| pixels <= MAX_PIXELS);
    let mut data = vec![0; size.ok_or_else(|| fault(format!("a picture of {width} x {height} pixels")))?];
    reader.next_frame(&mut data).map_err(|error| fault(error.to_string()))?;
    let channel = |number: usize| data.iter().skip(number).step_by(channels).copied().collect();
    let alpha = if channels == 2 { channel(1) } else { Vec::new() };
    Ok(GreyImage { width, height, maximum: u8::MAX, pixels: channel(0), alpha })
}

/// Parses a PGM file.
fn parse_pgm(bytes: &[u8], path: &Path) -> Result<GreyImage, FormatError> {
    let fault = |offset: usize, cause: String| FormatError::malformed(path, offset as u64, cause, REMEDY);
    if !bytes.starts_with(b"P5") {
        return Err(fault(0, "the file does not start with P5".to_owned()));
    }
    let mut at = 2;
    let mut number = |name: &str| {
        let (value, end) =
            header_number(bytes, at).ok_or_else(|| fault(at, format!("no {name} in the header")))?;
        at = end;
        Ok(value)
    };
    let (width, height, maximum) = (number("width")?, number("height")?, number("maximum")?);
    let Some(maximum) = u8::try_from(maximum).ok().filter(|maximum| *maximum > 0) else {
        return Err(fault(at, format!("a maximum grey of {maximum} where 1 to 255 are read")));
    };
    if width == 0 || height == 0 {
        return Err(fault(at, format!("a picture of {width} x {height} pixels")));
    }
    // One white space separates the header from the pixels.
    let pixels = bytes.get(at + 1..).unwrap_or_default();
    let wanted = u64::from(width) * u64::from(height);
    let Some(pixels) = usize::try_from(wanted).ok().and_then(|wanted| pixels.get(..wanted)) else {
        let cause = format!("{} of {width} x {height} pixels are there", pixels.len());
        return Err(FormatError::malformed(
            path,
            bytes.len() as u64,
            cause,
            "the file was cut: save it again",
        ));
    };
    Ok(GreyImage { width, height, maximum, pixels: pixels.to_vec(), alpha: Vec::new() })
}

/// The next number after white space and comments, and where it ends.
fn header_number(bytes: &[u8], mut at: usize) -> Option<(u32, usize)> {
    loop {
        match bytes.get(at)? {
            b'#' => at += bytes.get(at..)?.iter().position(|byte| *byte == b'\n')?,
            byte if byte.is_ascii_whitespace() => at += 1,
            _ => break,
        }
    }
    let rest = bytes.get(at..)?;
    let digits = rest.iter().position(|byte| !byte.is_ascii_digit()).unwrap_or(rest.len());
    let value = std::str::from_utf8(rest.get(..digits)?).ok()?.parse().ok()?;
    Some((value, at + digits))
}

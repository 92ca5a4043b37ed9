//! The text in front of the tree.

use super::Fault;
use super::tree::is_resolution;

const FULL_MAGIC: &[u8] = b"# Octomap OcTree file";
const BINARY_MAGIC: &[u8] = b"# Octomap OcTree binary file";
/// First number of a `.bt` from before there were text headers.
const LEGACY_TREE_TYPE: [u8; 4] = 3i32.to_le_bytes();
const LEGACY_BYTES: usize = 16;

/// Which body follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    /// `.ot`
    Full,
    /// `.bt`
    Binary,
}

/// What the text says.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) kind: Kind,
    /// Nodes in the tree, by the header's word.
    pub(super) size: u64,
    /// Edge of a voxel, metres.
    pub(super) resolution: f64,
    /// Where the body starts.
    pub(super) body: usize,
}

impl Header {
    /// The header that OctoMap writes.
    pub(super) fn text(kind: Kind, size: usize, resolution: f64) -> Vec<u8> {
        let mut bytes = match kind {
            Kind::Full => FULL_MAGIC.to_vec(),
            Kind::Binary => BINARY_MAGIC.to_vec(),
        };
        bytes.extend_from_slice(
            b"\n# (feel free to add / change comments, but leave the first line as it is!)\n#\nid OcTree\n",
        );
        let resolution = general(resolution);
        bytes.extend_from_slice(format!("size {size}\nres {resolution}\ndata\n").as_bytes());
        bytes
    }

    /// Reads the header, or says that these are not OctoMap's bytes.
    pub(super) fn read(bytes: &[u8]) -> Result<Self, Fault> {
        if bytes.is_empty() {
            return Err(Fault::new(0, "the file is empty", "copy or write it again"));
        }
        if bytes.starts_with(BINARY_MAGIC) {
            return Self::read_text(bytes, Kind::Binary);
        }
        if bytes.starts_with(FULL_MAGIC) {
            return Self::read_text(bytes, Kind::Full);
        }
        if bytes.starts_with(&LEGACY_TREE_TYPE) {
            return Self::read_legacy(bytes);
        }
        if FULL_MAGIC.starts_with(bytes) || BINARY_MAGIC.starts_with(bytes) {
            return Err(Fault::truncated(bytes.len(), "its first line"));
        }
        Err(Fault::new(0, "the first line is not that of an OctoMap file", "give a .ot or .bt file"))
    }

    fn read_text(bytes: &[u8], kind: Kind) -> Result<Self, Fault> {
        let mut words = Words { bytes, at: 0 };
        words.skip_line();
        let mut id: Option<(usize, &[u8])> = None;
        let mut size: Option<u64> = None;
        let mut resolution: Option<f64> = None;
        loop {
            let (offset, word) = words.next("its header (no line \"data\")")?;
            match word {
                b"data" => break,
                b"id" => id = Some(words.next("the id")?),
                b"size" => size = Some(words.number("size", "a number of nodes below 2^32")?),
                b"res" => resolution = Some(words.number("res", "the edge of a voxel in metres")?),
                _ => words.rest_of_line_from(offset),
            }
        }
        words.skip_line();
        let (at, id) =
            id.ok_or_else(|| Fault::new(words.at, "the header has no id", "add the line \"id OcTree\""))?;
        // "1" is what old versions wrote.
        if id != b"OcTree" && id != b"1" {
            let cause = format!("the tree's id is {}, not OcTree", String::from_utf8_lossy(id));
            return Err(Fault::new(at, cause, "save the map as a plain OcTree"));
        }
        let size = size.ok_or_else(|| {
            Fault::new(words.at, "the header has no size", "add the line \"size\" with the number of nodes")
        })?;
        checked(kind, size, resolution.unwrap_or_default(), words.at)
    }

    fn read_legacy(bytes: &[u8]) -> Result<Self, Fault> {
        let header = bytes.first_chunk::<LEGACY_BYTES>();
        let &[_, _, _, _, a, b, c, d, e, f, g, h, i, j, k, l] =
            header.ok_or_else(|| Fault::truncated(bytes.len(), "its header"))?;
        let resolution = f64::from_le_bytes([a, b, c, d, e, f, g, h]);
        let size = u64::from(u32::from_le_bytes([i, j, k, l]));
        checked(Kind::Binary, size, resolution, LEGACY_BYTES)
    }
}

fn checked(kind: Kind, size: u64, resolution: f64, body: usize) -> Result<Header, Fault> {
    let damaged = "the file is damaged: write it again from its source";
    if !is_resolution(resolution) {
        return Err(Fault::new(body, format!("the resolution is missing or {resolution} m"), damaged));
    }
    if size > u64::from(u32::MAX) {
        return Err(Fault::new(body, format!("the header says {size} nodes"), damaged));
    }
    Ok(Header { kind, size, resolution, body })
}

/// Words between white space, as C++ streams read them.
struct Words<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Words<'a> {
    fn next(&mut self, inside: &str) -> Result<(usize, &'a [u8]), Fault> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let Some(skip) = rest.iter().position(|&byte| !is_space(byte)) else {
            return Err(Fault::truncated(self.bytes.len(), inside));
        };
        let word = &rest[skip..];
        let length = word.iter().position(|&byte| is_space(byte)).unwrap_or(word.len());
        let offset = self.at + skip;
        self.at = offset + length;
        Ok((offset, &word[..length]))
    }

    fn number<T: std::str::FromStr>(&mut self, field: &str, meaning: &str) -> Result<T, Fault> {
        let (offset, word) = self.next("its header")?;
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        number.ok_or_else(|| {
            let shown = String::from_utf8_lossy(word.get(..32).unwrap_or(word));
            Fault::new(
                offset,
                format!("\"{field} {shown}\" is not {meaning}"),
                "the file is damaged: write it again from its source",
            )
        })
    }

    /// A comment or an unknown field: the rest of its line means nothing.
    fn rest_of_line_from(&mut self, offset: usize) {
        self.at = offset;
        self.skip_line();
    }

    fn skip_line(&mut self) {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        self.at += rest.iter().position(|&byte| byte == b'\n').map_or(rest.len(), |end| end + 1);
    }
}

fn is_space(byte: u8) -> bool {
    byte == b' ' || (b'\t'..=b'\r').contains(&byte)
}

/// A number as C++ streams print it by default, `%g`: six significant digits, no trailing zeros.
fn general(number: f64) -> String {
    const DIGITS: i32 = 6;
    let scientific = format!("{number:.*e}", DIGITS as usize - 1);
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or_default();
    if (-4..DIGITS).contains(&exponent) {
        return without_trailing_zeros(&format!("{number:.*}", (DIGITS - 1 - exponent) as usize)).to_owned();
    }
    let sign = if exponent < 0 { '-' } else { '+' };
    format!("{}e{sign}{:02}", without_trailing_zeros(mantissa), exponent.abs())
}

fn without_trailing_zeros(number: &str) -> &str {
    if number.contains('.') { number.trim_end_matches('0').trim_end_matches('.') } else { number }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resolution_is_printed_as_c_plus_plus_streams_print_it() {
        // Right column: printf("%g").
        let cases = [
            (0.1, "0.1"),
            (0.05, "0.05"),
            (1.0, "1"),
            (0.123_456_789, "0.123457"),
            (0.1 + 0.2, "0.3"),
            (1234.5678, "1234.57"),
            (999_999.5, "1e+06"),
            (100_000.0, "100000"),
            (0.0001, "0.0001"),
            (0.000_099_999_96, "0.0001"),
            (0.000_012_345_678, "1.23457e-05"),
            (2.5e-112, "2.5e-112"),
        ];
        for (number, printed) in cases {
            assert_eq!(general(number), printed);
        }
    }
}

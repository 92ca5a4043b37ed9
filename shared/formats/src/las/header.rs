//! The public header block and the one variable length record that LAZ needs.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use crate::FormatError;

/// Bytes of the header up to LAS 1.2, and of 1.4.
const HEADER: usize = 227;
const HEADER_1_4: usize = 375;
/// Bytes before the contents of a variable length record.
const RECORD_HEADER: u64 = 54;
/// Bytes of a point by format.
const POINT_BYTES: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// What a LAS header says.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Major and minor version.
    pub version: [u8; 2],
    /// Point data record format, 0 to 10.
    pub format: u8,
    /// Number of points.
    pub points: u64,
    /// Bytes of one point.
    pub record: u16,
    /// Metres (or the projection's unit) of one step of the stored whole numbers, by axis.
    pub scale: [f64; 3],
    /// Coordinates of the stored zero.
    pub offset: [f64; 3],
    /// Whether the points are compressed.
    pub compressed: bool,
    /// Where the points begin.
    pub(super) data: u64,
    /// Contents of the record `laszip encoded`.
    pub(super) laszip: Option<Vec<u8>>,
    /// Bytes of the whole file.
    pub(super) file: u64,
}

impl Header {
    /// Reads the header and leaves the source where the points begin.
    pub(super) fn read(source: &mut (impl Read + Seek), path: &Path) -> Result<Self, FormatError> {
        let io = |cause| FormatError::reading(path, cause);
        let file = source.seek(SeekFrom::End(0)).map_err(io)?;
        source.rewind().map_err(io)?;
        let mut block = Vec::with_capacity(HEADER_1_4);
        source.take(HEADER_1_4 as u64).read_to_end(&mut block).map_err(io)?;
        let (mut header, head, records) = Self::parse(&block, file).map_err(|(offset, cause)| {
            FormatError::malformed(path, offset, cause, "check that this is a whole LAS file")
        })?;
        if header.compressed {
            header.laszip = find_laszip(source, path, head, records, header.data)?;
        }
        source.seek(SeekFrom::Start(header.data)).map_err(io)?;
        Ok(header)
    }

    /// The header, its length and the number of records behind it.
    fn parse(block: &[u8], file: u64) -> Result<(Self, u16, u32), (u64, String)> {
        if block.get(..4) != Some(b"LASF") {
            return Err((0, "the file does not begin with LASF".to_owned()));
        }
        if block.len() < HEADER {
            return Err((block.len() as u64, "the file ends inside its header".to_owned()));
        }
        let version = [u8_at(block, 24), u8_at(block, 25)];
        if version[0] != 1 || version[1] > 4 {
            let [major, minor] = version;
            return Err((24, format!("version {major}.{minor} where 1.0 to 1.4 are supported")));
        }
        let head = u16_at(block, 94);
        let least = if version[1] == 4 { HEADER_1_4 } else { HEADER };
        if usize::from(head) < least || block.len() < least {
            return Err((94, format!("a header of {head} bytes where version 1.{} has {least}", version[1])));
        }
        // LAZ marks the format with the highest bit, old writers with the next one.
        let (format, compressed) = (u8_at(block, 104) & 0x3f, u8_at(block, 104) & 0xc0 != 0);
        let record = u16_at(block, 105);
        match POINT_BYTES.get(usize::from(format)) {
            None => return Err((104, format!("point format {format} where 0 to 10 are known"))),
            Some(least) if record < *least => {
                return Err((105, format!("points of {record} bytes where format {format} has {least}")));
            }
            Some(_) => {}
        }
        let old = u64::from(u32_at(block, 107));
        let points = if version[1] == 4 { u64_at(block, 247).max(old) } else { old };
        let three = |at: usize| [0, 8, 16].map(|axis| f64::from_bits(u64_at(block, at + axis)));
        let (scale, offset) = (three(131), three(155));
        if !scale.iter().all(|scale| scale.is_normal()) || !offset.iter().all(|offset| offset.is_finite()) {
            return Err((131, format!("scale {scale:?} and offset {offset:?} give no coordinates")));
        }
        let data = u64::from(u32_at(block, 96));
        if data < u64::from(head) || data > file {
            return Err((96, format!("points at byte {data} of a file of {file} bytes")));
        }
        let there = (file - data) / u64::from(record);
        if !compressed && points > there {
            return Err((file, format!("{points} points are announced, {there} are there")));
        }
        let header =
            Self { version, format, points, record, scale, offset, compressed, data, laszip: None, file };
        Ok((header, head, u32_at(block, 100)))
    }
}

/// Looks through the variable length records between header and points.
fn find_laszip(
    source: &mut (impl Read + Seek),
    path: &Path,
    head: u16,
    records: u32,
    data: u64,
) -> Result<Option<Vec<u8>>, FormatError> {
    let io = |cause| FormatError::reading(path, cause);
    let mut at = u64::from(head);
    for _ in 0..records {
        if at + RECORD_HEADER > data {
            break;
        }
        source.seek(SeekFrom::Start(at)).map_err(io)?;
        let mut record = [0; RECORD_HEADER as usize];
        source.read_exact(&mut record).map_err(io)?;
        let length = u16_at(&record, 20);
        if record.get(2..16) == Some(b"laszip encoded") && u16_at(&record, 18) == 22204 {
            let mut contents = vec![0; usize::from(length)];
            source.read_exact(&mut contents).map_err(io)?;
            return Ok(Some(contents));
        }
        at += RECORD_HEADER + u64::from(length);
    }
    Ok(None)
}

fn bytes_at<const N: usize>(block: &[u8], at: usize) -> [u8; N] {
    block.get(at..).and_then(|rest| rest.first_chunk()).copied().unwrap_or([0; N])
}

pub(super) fn u8_at(block: &[u8], at: usize) -> u8 {
    block.get(at).copied().unwrap_or_default()
}

pub(super) fn u16_at(block: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(bytes_at(block, at))
}

pub(super) fn u32_at(block: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes_at(block, at))
}

fn u64_at(block: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes_at(block, at))
}

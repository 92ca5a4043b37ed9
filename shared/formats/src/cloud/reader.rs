//! A cloud file of any kind, told by its first bytes.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use super::{CloudPoint, Origin};
use crate::{FormatError, las, pcd, ply};

/// Which format a cloud file has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Point Cloud Data.
    Pcd,
    /// Polygon file.
    Ply,
    /// ASPRS LAS, plain or as LAZ.
    Las,
}

impl Kind {
    /// What the first bytes of a file say: PLY and LAS begin with their names, everything else is taken for PCD, whose
    /// header says soon enough that it is none.
    pub fn of(first: &[u8]) -> Self {
        match first {
            [b'p', b'l', b'y', b'\n' | b'\r', ..] => Self::Ply,
            [b'L', b'A', b'S', b'F', ..] => Self::Las,
            _ => Self::Pcd,
        }
    }

    fn of_file(path: &Path) -> Result<Self, FormatError> {
        let mut first = Vec::with_capacity(4);
        let read = File::open(path).and_then(|file| file.take(4).read_to_end(&mut first));
        read.map_err(|cause| FormatError::reading(path, cause))?;
        Ok(Self::of(&first))
    }
}

/// Streams the points of a PCD, PLY, LAS or LAZ file in file order, in bounded memory (but see [`pcd::Reader`] about
/// compressed PCD). After an error the iterator ends.
pub enum Reader {
    /// Point Cloud Data.
    Pcd(pcd::Reader<BufReader<File>>),
    /// Polygon file.
    Ply(ply::Reader<BufReader<File>>),
    /// ASPRS LAS, plain or as LAZ.
    Las(Box<las::Reader<BufReader<File>>>),
}

impl Reader {
    /// Opens a file and reads its header; `origin` is taken off all coordinates.
    ///
    /// # Errors
    /// [`FormatError`] of the format's own reader.
    pub fn open(path: &Path, origin: Origin) -> Result<Self, FormatError> {
        Ok(match Kind::of_file(path)? {
            Kind::Pcd => Self::Pcd(pcd::Reader::open(path)?.with_origin(origin)),
            Kind::Ply => Self::Ply(ply::Reader::open(path)?.with_origin(origin)),
            Kind::Las => Self::Las(Box::new(las::Reader::open(path)?.with_origin(origin))),
        })
    }

    /// Points that the header announces.
    pub fn points(&self) -> u64 {
        match self {
            Self::Pcd(reader) => reader.header().points,
            Self::Ply(reader) => reader.points(),
            Self::Las(reader) => reader.header().points,
        }
    }
}

impl Iterator for Reader {
    type Item = Result<CloudPoint, FormatError>;

    #[inline]
    fn next(&mut self) -> Option<Self::Item> {
        match self {
            Self::Pcd(reader) => reader.next(),
            Self::Ply(reader) => reader.next(),
            Self::Las(reader) => reader.next(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_bytes_tell_the_format_whatever_the_name() {
        assert_eq!(Kind::of(b"ply\nformat"), Kind::Ply);
        assert_eq!(Kind::of(b"ply\r\n"), Kind::Ply);
        assert_eq!(Kind::of(b"LASF\0\0"), Kind::Las);
        assert_eq!(Kind::of(b"# .PCD v0.7"), Kind::Pcd);
        assert_eq!(Kind::of(b"VERSION"), Kind::Pcd);
        assert_eq!(Kind::of(b""), Kind::Pcd);
    }
}

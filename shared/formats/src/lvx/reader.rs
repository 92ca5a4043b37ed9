//! Packet after packet, each turned into the datagram that the device sent.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::header::{Device, SIGNATURE, Version};
use crate::FormatError;
use crate::livox_sdk1;

const CUT: &str = "copy it again, or use what is before with --allow-truncated";
const DAMAGED: &str = "the file is damaged there: copy it again, or record it anew";

/// A device number and the header of the first protocol before the records.
const SDK1_HEADER: usize = 1 + 18;
const SDK2_HEADER: usize = 36;
/// Bytes of a package's header in LVX2.
const PACKAGE_HEADER: usize = 27;
/// Points of a packet in LVX 1.0, each three floats and a byte.
const FLOAT_POINTS: usize = 100;
/// A datagram of the second protocol is no longer than this.
const MAX_POINT_BYTES: usize = 65_000;
/// 50 ms, for files that do not say how long their frames are.
const FRAME_NS: i64 = 50_000_000;

/// A data packet of a recording.
#[derive(Debug, Clone, Copy)]
pub struct LvxPacket<'a> {
    /// Which device, see [`Device::id`].
    pub device: u32,
    /// About when it came: the frame's number times its length.
    pub time_ns: i64,
    /// Where it begins in the file.
    pub offset: u64,
    /// The datagram: of the first protocol for LVX 1, of the second, without its checksum, for LVX2. LVX 1.0's floats are whole
    /// millimetres again.
    pub datagram: &'a [u8],
}

/// Streams the packets of a recording in the order of arrival; memory holds one.
#[derive(Debug)]
pub struct LvxReader {
    path: PathBuf,
    file: BufReader<File>,
    version: Version,
    devices: Vec<Device>,
    frame_ns: i64,
    length: u64,
    offset: u64,
    /// Where the frame at hand ends, and when it was recorded.
    frame_end: u64,
    time_ns: i64,
    packet: Vec<u8>,
    datagram: Vec<u8>,
    tolerant: bool,
    truncated_at: Option<u64>,
    skipped: u64,
}

impl LvxReader {
    /// Opens a recording and reads its table of devices.
    ///
    /// # Errors
    /// [`FormatError`] if it is no recording of a known version.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let failed = |cause| FormatError::reading(path, cause);
        let file = File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        let mut file = BufReader::with_capacity(1 << 18, file);
        let refused = |offset, cause: &str| FormatError::malformed(path, offset, cause, DAMAGED);
        let mut start = [0; SIGNATURE];
        let version = if file.read_exact(&mut start).is_ok() { Version::of(&start) } else { None };
        let version = version.ok_or_else(|| refused(0, "this is no LVX 1.0, 1.1 or LVX2 recording"))?;
        let mut private = vec![0; version.private_header()];
        file.read_exact(&mut private).map_err(failed)?;
        let count = usize::from(private.pop().unwrap_or_default());
        let duration = private.first_chunk().map(|bytes| i64::from(u32::from_le_bytes(*bytes)));
        let mut entries = vec![0; count * version.entry()];
        file.read_exact(&mut entries)
            .map_err(|_| refused(length, "the file ends inside its table of devices"))?;
        let devices =
            entries.chunks_exact(version.entry()).filter_map(|entry| version.device(entry)).collect();
        let offset = (SIGNATURE + version.private_header() + entries.len()) as u64;
        Ok(Self {
            path: path.to_owned(),
            file,
            version,
            devices,
            frame_ns: duration.filter(|ms| (1..=10_000).contains(ms)).map_or(FRAME_NS, |ms| ms * 1_000_000),
            length,
            offset,
            frame_end: offset,
            time_ns: 0,
            packet: Vec::new(),
            datagram: Vec::new(),
            tolerant: false,
            truncated_at: None,
            skipped: 0,
        })
    }

    /// With `tolerant`, a file that is cut off ends at its last whole packet instead of with an error.
    pub fn tolerate_truncation(self, tolerant: bool) -> Self {
        Self { tolerant, ..self }
    }

    /// The file, as it was named.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Which layout the file has.
    pub fn version(&self) -> Version {
        self.version
    }

    /// The table of devices.
    pub fn devices(&self) -> &[Device] {
        &self.devices
    }

    /// Bytes read.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// Where the file ends inside a packet, if it does and that was tolerated.
    pub fn truncated_at(&self) -> Option<u64> {
        self.truncated_at
    }

    /// Rests of frames that were left out, since they begin with a packet of unknown kind.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// The next packet, `None` after the last.
    ///
    /// # Errors
    /// [`FormatError`] naming the place of a frame or packet that is not as it must be.
    pub fn next_packet(&mut self) -> Result<Option<LvxPacket<'_>>, FormatError> {
        while self.truncated_at.is_none() {
            if self.offset == self.frame_end {
                if self.offset == self.length {
                    break;
                }
                self.frame()?;
                continue;
            }
            let offset = self.offset;
            let device = match self.version {
                Version::V1_0 | Version::V1_1 => self.sdk1_packet()?,
                Version::V2 => self.package()?,
            };
            if let Some(device) = device {
                return Ok(Some(LvxPacket {
                    device,
                    time_ns: self.time_ns,
                    offset,
                    datagram: &self.datagram,
                }));
            }
        }
        Ok(None)
    }

    /// Reads a frame's header.
    fn frame(&mut self) -> Result<(), FormatError> {
        let (start, size) = (self.offset, self.version.frame_header());
        self.packet.clear();
        if !self.read(size, self.length)? {
            return Ok(());
        }
        let number = |at: usize| {
            self.packet.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |bytes| u64::from_le_bytes(*bytes))
        };
        let (current, next, index) = (number(0), number(8), number(16));
        if current != start || next < self.offset {
            let cause = format!("the frame says that it begins at byte {current} and ends at byte {next}");
            return Err(self.refused(start, cause, DAMAGED));
        }
        if next > self.length && !self.tolerant {
            let cause = format!("the frame ends at byte {next} and the file at byte {}", self.length);
            return Err(self.refused(start, cause, CUT));
        }
        let index = i64::try_from(index).unwrap_or(i64::MAX);
        (self.frame_end, self.time_ns) = (next, index.saturating_mul(self.frame_ns));
        Ok(())
    }

    /// A packet of LVX 1; `None` where the frame or file ends before it.
    fn sdk1_packet(&mut self) -> Result<Option<u32>, FormatError> {
        let start = self.offset;
        self.packet.clear();
        if !self.read(SDK1_HEADER, self.frame_end)? {
            return Ok(None);
        }
        let (version, data_type) = match self.packet.as_slice() {
            [_, version, _, _, _, _, _, _, _, _, data_type, ..] => (*version, *data_type),
            _ => (0, 0),
        };
        if version != 5 {
            let cause = format!("the packet's version is {version}, not 5");
            return Err(self.refused(start, cause, DAMAGED));
        }
        let floats = self.version == Version::V1_0;
        let records = match livox_sdk1::DataType::from_wire(data_type) {
            _ if floats => FLOAT_POINTS * 13,
            Some(kind) => shots(kind) * kind.record_bytes(),
            None => {
                // There is no length by which to go on.
                self.skipped += 1;
                self.seek(self.frame_end.min(self.length))?;
                return Ok(None);
            }
        };
        if !self.read(records, self.frame_end)? {
            return Ok(None);
        }
        let Some((device, datagram)) = self.packet.split_first() else { return Ok(None) };
        self.datagram.clear();
        self.datagram.extend_from_slice(datagram);
        if floats {
            to_millimetres(&mut self.datagram);
        }
        Ok(Some(u32::from(*device)))
    }

    /// A package of LVX2, made the datagram that it was; `None` where the frame or file ends before it.
    fn package(&mut self) -> Result<Option<u32>, FormatError> {
        let start = self.offset;
        self.packet.clear();
        if !self.read(PACKAGE_HEADER, self.frame_end)? {
            return Ok(None);
        }
        let Some(header) = self.packet.first_chunk::<PACKAGE_HEADER>().copied() else { return Ok(None) };
        let [_, i0, i1, i2, i3, _, time_type, stamp @ .., u0, u1, kind, l0, l1, l2, l3, frame, _, _, _, _] =
            header;
        let length = u32::from_le_bytes([l0, l1, l2, l3]) as usize;
        let record = match kind {
            1 => 14,
            2 => 8,
            _ => 10,
        };
        if length > MAX_POINT_BYTES || !length.is_multiple_of(record) {
            let cause = format!("the package claims {length} bytes of points of type {kind}");
            return Err(self.refused(start, cause, DAMAGED));
        }
        if !self.read(length, self.frame_end)? {
            return Ok(None);
        }
        let [s0, s1] = ((SDK2_HEADER + length) as u16).to_le_bytes();
        let [n0, n1] = ((length / record) as u16).to_le_bytes();
        self.datagram.clear();
        self.datagram.extend_from_slice(&[0, s0, s1, 0, 0, n0, n1, u0, u1, frame, kind, time_type]);
        self.datagram.resize(SDK2_HEADER - stamp.len(), 0);
        self.datagram.extend_from_slice(&stamp);
        self.datagram.extend_from_slice(self.packet.get(PACKAGE_HEADER..).unwrap_or_default());
        Ok(Some(u32::from_le_bytes([i0, i1, i2, i3])))
    }

    /// Appends `size` bytes to the packet, which must end before `end`; false where the file is cut off and that is tolerated.
    fn read(&mut self, size: usize, end: u64) -> Result<bool, FormatError> {
        let after = self.offset + size as u64;
        if after > self.length {
            if self.tolerant {
                self.truncated_at = Some(self.offset);
                return Ok(false);
            }
            let cause = format!("the file ends inside a packet, after {} bytes", self.length);
            return Err(self.refused(self.offset, cause, CUT));
        }
        if after > end {
            let cause = format!("the packet goes on to byte {after}, beyond the frame's end at byte {end}");
            return Err(self.refused(self.offset, cause, DAMAGED));
        }
        let start = self.packet.len();
        self.packet.resize(start + size, 0);
        let to = self.packet.get_mut(start..).unwrap_or_default();
        self.file.read_exact(to).map_err(|cause| FormatError::reading(&self.path, cause))?;
        self.offset = after;
        Ok(true)
    }

    fn seek(&mut self, offset: u64) -> Result<(), FormatError> {
        self.file.seek(SeekFrom::Start(offset)).map_err(|cause| FormatError::reading(&self.path, cause))?;
        self.offset = offset;
        self.frame_end = offset;
        Ok(())
    }

    fn refused(&self, offset: u64, cause: String, remedy: &str) -> FormatError {
        FormatError::malformed(&self.path, offset, cause, remedy)
    }
}

/// Records of a full packet of the first protocol.
fn shots(kind: livox_sdk1::DataType) -> usize {
    use livox_sdk1::DataType::{
        Cartesian, DualCartesian, DualSpherical, ExtendedCartesian, ExtendedSpherical, Imu, Spherical,
        TripleCartesian, TripleSpherical,
    };
    match kind {
        Cartesian | Spherical => 100,
        ExtendedCartesian | ExtendedSpherical => 96,
        DualCartesian | DualSpherical => 48,
        TripleCartesian | TripleSpherical => 30,
        Imu => 1,
    }
}

/// Floats of metres become the millimetres that they were, whatever type the header had.
fn to_millimetres(datagram: &mut [u8]) {
    if let Some(data_type) = datagram.get_mut(9) {
        *data_type = 0;
    }
    let points = datagram.get_mut(18..).unwrap_or_default();
    for point in points.as_chunks_mut::<13>().0 {
        for axis in point.as_chunks_mut::<4>().0 {
            *axis = ((f64::from(f32::from_le_bytes(*axis)) * 1e3).round() as i32).to_le_bytes();
        }
    }
}

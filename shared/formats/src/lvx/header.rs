//! The start of a file: signature, version, and a table of devices.

/// Bytes before the private header.
pub(super) const SIGNATURE: usize = 24;

/// Which layout a file has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Version {
    /// 1.0: packets of 100 points as floats.
    V1_0,
    /// 1.1: packets of the first protocol as they came.
    V1_1,
    /// 2.0: packets of the second protocol.
    V2,
}

/// A device of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct Device {
    /// Serial number.
    pub code: String,
    /// Number by which packets name it.
    pub id: u32,
    /// Kind of device in the maker's numbering.
    pub kind: u8,
    /// Roll, pitch and yaw in degrees and x, y and z in metres, where the maker's programs are to move its points by
    /// Rz Ry Rx; the points in the file are where the device saw them.
    pub extrinsic: Option<[f32; 6]>,
}

impl Version {
    /// The version of the bytes at a file's start; the signature is compared, the magic number is not (the maker's own reader
    /// ignores it).
    pub(super) fn of(start: &[u8; SIGNATURE]) -> Option<Self> {
        if !start.starts_with(b"livox_tech\0") {
            return None;
        }
        match [start[16], start[17]] {
            [1, 0] => Some(Self::V1_0),
            [1, 1] => Some(Self::V1_1),
            [2, 0] => Some(Self::V2),
            _ => None,
        }
    }

    /// Bytes of the private header, which ends with the number of devices.
    pub(super) fn private_header(self) -> usize {
        match self {
            Self::V1_0 => 1,
            Self::V1_1 | Self::V2 => 5,
        }
    }

    /// Bytes of a device's entry.
    pub(super) fn entry(self) -> usize {
        match self {
            Self::V1_0 => 58,
            Self::V1_1 => 59,
            Self::V2 => 63,
        }
    }

    /// Bytes of a frame's header: offsets of this frame and the next, number, and in 1.0 the number of packets.
    pub(super) fn frame_header(self) -> usize {
        match self {
            Self::V1_0 => 32,
            Self::V1_1 | Self::V2 => 24,
        }
    }

    pub(super) fn device(self, entry: &[u8]) -> Option<Device> {
        let code = entry.get(..16)?.split(|byte| *byte == 0).next().unwrap_or_default();
        let (id, rest) = match self {
            Self::V2 => (u32::from_le_bytes(*entry.get(32..)?.first_chunk()?), entry.get(37..)?),
            _ => (u32::from(*entry.get(32)?), entry.get(33..)?),
        };
        let (kind, rest) = rest.split_first()?;
        let (enabled, numbers) = match self {
            Self::V1_0 => (false, rest),
            _ => rest.split_first().map(|(enabled, rest)| (*enabled != 0, rest))?,
        };
        let mut extrinsic = [0.0; 6];
        for (value, bytes) in extrinsic.iter_mut().zip(numbers.as_chunks::<4>().0) {
            *value = f32::from_le_bytes(*bytes);
        }
        let code = String::from_utf8_lossy(code).into_owned();
        Some(Device { code, id, kind: *kind, extrinsic: enabled.then_some(extrinsic) })
    }
}

//! A file of a device's packets: a capture of the network, or a recording of Livox Viewer.

use std::fs::File;
use std::io::{BufReader, Read as _};
use std::net::Ipv4Addr;
use std::path::Path;

use evac_formats::FormatError;
use evac_formats::lvx::LvxReader;
use evac_formats::pcap::{PcapCounts, PcapReader};

/// Datagrams of a file in the order of arrival.
pub(super) enum PacketFile {
    Pcap(PcapReader<BufReader<File>>),
    Lvx(LvxReader),
}

/// A datagram that may be a device's.
pub(super) struct RawPacket<'a> {
    /// Who sent it; in a recording its number of the device, as four bytes.
    pub(super) source: Ipv4Addr,
    /// When it came.
    pub(super) time_ns: i64,
    pub(super) payload: &'a [u8],
    pub(super) offset: u64,
}

impl PacketFile {
    pub(super) fn open(path: &Path, tolerant: bool) -> Result<Self, FormatError> {
        let mut magic = Vec::with_capacity(10);
        File::open(path)
            .and_then(|file| file.take(10).read_to_end(&mut magic))
            .map_err(|cause| FormatError::reading(path, cause))?;
        if magic == b"livox_tech" {
            return Ok(Self::Lvx(LvxReader::open(path)?.tolerate_truncation(tolerant)));
        }
        Ok(Self::Pcap(PcapReader::open(path)?.tolerate_truncation(tolerant)))
    }

    pub(super) fn next_packet(&mut self) -> Result<Option<RawPacket<'_>>, FormatError> {
        Ok(match self {
            Self::Pcap(reader) => reader.next_datagram()?.map(|udp| RawPacket {
                source: *udp.source.ip(),
                time_ns: udp.time_ns,
                payload: udp.payload,
                offset: udp.offset,
            }),
            Self::Lvx(reader) => reader.next_packet()?.map(|packet| RawPacket {
                source: Ipv4Addr::from(packet.device.to_le_bytes()),
                time_ns: packet.time_ns,
                payload: packet.datagram,
                offset: packet.offset,
            }),
        })
    }

    /// Whether the packets of the second protocol still have their checksum.
    pub(super) fn has_checksums(&self) -> bool {
        matches!(self, Self::Pcap(_))
    }

    pub(super) fn path(&self) -> &Path {
        match self {
            Self::Pcap(reader) => reader.path(),
            Self::Lvx(reader) => reader.path(),
        }
    }

    /// Bytes read.
    pub(super) fn offset(&self) -> u64 {
        match self {
            Self::Pcap(reader) => reader.offset(),
            Self::Lvx(reader) => reader.offset(),
        }
    }

    pub(super) fn counts(&self) -> PcapCounts {
        match self {
            Self::Pcap(reader) => reader.counts(),
            Self::Lvx(reader) => PcapCounts {
                cut: reader.skipped(),
                truncated_at: reader.truncated_at(),
                ..PcapCounts::default()
            },
        }
    }

    /// Says what a recording knows about its devices.
    pub(super) fn tell(&self) {
        let Self::Lvx(reader) = self else { return };
        let file = reader.path().display();
        for device in reader.devices() {
            tracing::info!("{file}: {:?} of device {}, kind {}", reader.version(), device.code, device.kind);
            if device.extrinsic.is_some_and(|extrinsic| extrinsic != [0.0; 6]) {
                tracing::info!("{file}: its extrinsic is left out; say in the rig file where the LiDAR sits");
            }
        }
    }
}

//! Reads a capture packet by packet.

use std::fs::File;
use std::io::{BufReader, Read};
use std::net::SocketAddrV4;
use std::path::{Path, PathBuf};

use super::link::{LinkType, Packet, classify};
use crate::FormatError;

/// No link that carries a LiDAR has longer packets; more is a broken length field.
const MAX_PACKET: u32 = 262_144;
const FILE_HEADER: u64 = 24;
const PACKET_HEADER: u64 = 16;

/// A UDP datagram of a capture.
#[derive(Debug, Clone, Copy)]
pub struct UdpDatagram<'a> {
    /// When it was captured, nanoseconds since 1970 of the capturing host.
    pub time_ns: i64,
    /// Who sent it.
    pub source: SocketAddrV4,
    /// To whom.
    pub destination: SocketAddrV4,
    /// Its payload.
    pub payload: &'a [u8],
    /// Where its packet begins in the file, bytes.
    pub offset: u64,
}

/// What a reader has come across.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PcapCounts {
    /// Packets of all kinds.
    pub packets: u64,
    /// Whole UDP datagrams over IPv4, which were handed out.
    pub datagrams: u64,
    /// Packets of other protocols.
    pub other: u64,
    /// Parts of fragmented datagrams, which are not put together.
    pub fragments: u64,
    /// Packets cut by the snap length, or with inconsistent lengths.
    pub cut: u64,
    /// Where the file ends inside a packet, if it does and that was [tolerated](PcapReader::tolerate_truncation).
    pub truncated_at: Option<u64>,
}

/// Streams the UDP datagrams of a classic pcap file in the order of capture; memory holds one packet.
///
/// Both byte orders, microsecond and nanosecond files; Ethernet (with VLAN tags), raw IP, loopback and Linux cooked
/// captures.
#[derive(Debug)]
pub struct PcapReader<R> {
    source: R,
    path: PathBuf,
    big_endian: bool,
    /// Nanoseconds of one unit of the fraction field.
    fraction_ns: i64,
    link: LinkType,
    offset: u64,
    packet: Vec<u8>,
    counts: PcapCounts,
    tolerant: bool,
}

impl PcapReader<BufReader<File>> {
    /// Opens a capture and checks its header.
    ///
    /// # Errors
    /// [`FormatError::Io`], or [`FormatError::Malformed`] if it is no capture of a known kind.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let file = File::open(path).map_err(|cause| FormatError::reading(path, cause))?;
        Self::new(BufReader::with_capacity(1 << 18, file), path)
    }
}

impl<R: Read> PcapReader<R> {
    /// Reads the file header from `source`; `path` is named in errors.
    ///
    /// # Errors
    /// As [`PcapReader::open`].
    pub fn new(mut source: R, path: &Path) -> Result<Self, FormatError> {
        let mut header = [0; FILE_HEADER as usize];
        let got = read_up_to(&mut source, &mut header).map_err(|cause| FormatError::reading(path, cause))?;
        let (magic, rest) = header.split_first_chunk::<4>().unwrap_or((&[0; 4], &[]));
        let (big_endian, fraction_ns) = match (*magic, got) {
            (_, 0) => return Err(refused(path, 0, "the file is empty", "record it again")),
            ([0xd4, 0xc3, 0xb2, 0xa1], _) => (false, 1000),
            ([0x4d, 0x3c, 0xb2, 0xa1], _) => (false, 1),
            ([0xa1, 0xb2, 0xc3, 0xd4], _) => (true, 1000),
            ([0xa1, 0xb2, 0x3c, 0x4d], _) => (true, 1),
            (magic, _) => return Err(foreign(path, magic)),
        };
        if (got as u64) < FILE_HEADER {
            let cause = format!("the file ends inside its {FILE_HEADER}-byte header");
            return Err(refused(path, got as u64, &cause, "record it again"));
        }
        let link_type = rest.get(16..).map_or(0, |bytes| u32_of(bytes, big_endian));
        let Some(link) = LinkType::from_wire(link_type) else {
            let cause = format!("link type {link_type} is not supported");
            return Err(refused(
                path,
                20,
                &cause,
                "capture on an Ethernet interface, or with `tcpdump -i any`",
            ));
        };
        Ok(Self {
            source,
            path: path.to_owned(),
            big_endian,
            fraction_ns,
            link,
            offset: FILE_HEADER,
            packet: Vec::with_capacity(2048),
            counts: PcapCounts::default(),
            tolerant: false,
        })
    }

    /// Whether a file that ends inside a packet (a capture that was killed) simply ends before it.
    #[must_use]
    pub fn tolerate_truncation(mut self, tolerant: bool) -> Self {
        self.tolerant = tolerant;
        self
    }

    /// The next UDP datagram, `None` at the end of the file.
    ///
    /// # Errors
    /// [`FormatError::Malformed`] where the file ends inside a packet or a length cannot be; [`FormatError::Io`].
    pub fn next_datagram(&mut self) -> Result<Option<UdpDatagram<'_>>, FormatError> {
        while let Some((time_ns, offset)) = self.read_packet()? {
            self.counts.packets += 1;
            match classify(self.link, &self.packet) {
                Packet::Other => self.counts.other += 1,
                Packet::Fragment => self.counts.fragments += 1,
                Packet::Cut => self.counts.cut += 1,
                Packet::Udp { source, destination, payload } => {
                    self.counts.datagrams += 1;
                    let payload = self.packet.get(payload).unwrap_or_default();
                    return Ok(Some(UdpDatagram { time_ns, source, destination, payload, offset }));
                }
            }
        }
        Ok(None)
    }

    /// What came by so far.
    pub fn counts(&self) -> PcapCounts {
        self.counts
    }

    /// Bytes read so far.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// The file, as it was named.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads a packet into the buffer; its time and where it begins.
    fn read_packet(&mut self) -> Result<Option<(i64, u64)>, FormatError> {
        let start = self.offset;
        let mut header = [0; PACKET_HEADER as usize];
        let got = self.read(&mut header)?;
        if got == 0 {
            return Ok(None);
        }
        if got < header.len() {
            return self.truncated(start, PACKET_HEADER, got);
        }
        let field = |at: usize| header.get(at..).map_or(0, |bytes| u32_of(bytes, self.big_endian));
        let (seconds, fraction, captured) = (field(0), field(4), field(8));
        if captured > MAX_PACKET {
            let cause = format!("packet {} claims {captured} bytes", self.counts.packets + 1);
            return Err(refused(
                &self.path,
                start,
                &cause,
                "the capture is damaged there: copy or record it again",
            ));
        }
        let mut packet = std::mem::take(&mut self.packet);
        packet.resize(captured as usize, 0);
        let got = self.read(&mut packet);
        self.packet = packet;
        let got = got?;
        if got < captured as usize {
            return self.truncated(start, PACKET_HEADER + u64::from(captured), PACKET_HEADER as usize + got);
        }
        self.offset = start + PACKET_HEADER + u64::from(captured);
        Ok(Some((i64::from(seconds) * 1_000_000_000 + i64::from(fraction) * self.fraction_ns, start)))
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, FormatError> {
        read_up_to(&mut self.source, buffer).map_err(|cause| FormatError::reading(&self.path, cause))
    }

    fn truncated(&mut self, start: u64, needed: u64, got: usize) -> Result<Option<(i64, u64)>, FormatError> {
        if self.tolerant {
            self.counts.truncated_at = Some(start);
            return Ok(None);
        }
        let cause = format!("the file ends inside a packet, which needs {needed} bytes and has {got}");
        Err(refused(&self.path, start, &cause, "copy it again, or use what is before with --allow-truncated"))
    }
}

/// Reads until the buffer is full or the source ends; how much it got.
fn read_up_to(source: &mut impl Read, buffer: &mut [u8]) -> std::io::Result<usize> {
    let mut got = 0;
    while let Some(rest) = buffer.get_mut(got..).filter(|rest| !rest.is_empty()) {
        match source.read(rest) {
            Ok(0) => break,
            Ok(n) => got += n,
            Err(cause) if cause.kind() == std::io::ErrorKind::Interrupted => {}
            Err(cause) => return Err(cause),
        }
    }
    Ok(got)
}

fn u32_of(bytes: &[u8], big_endian: bool) -> u32 {
    let bytes = bytes.first_chunk().copied().unwrap_or_default();
    if big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
}

fn refused(path: &Path, offset: u64, cause: &str, remedy: &str) -> FormatError {
    FormatError::malformed(path, offset, cause, remedy)
}

/// What a file is that is no pcap.
fn foreign(path: &Path, magic: [u8; 4]) -> FormatError {
    let (cause, remedy) = match magic {
        [0x0a, 0x0d, 0x0d, 0x0a] => ("this is a pcapng file", "convert it with `editcap -F pcap IN OUT`"),
        [0xfd, b'7', b'z', b'X'] => ("this is an xz archive", "unpack it with `xz -d`"),
        [0x1f, 0x8b, ..] => ("this is a gzip archive", "unpack it with `gzip -d`"),
        [0x28, 0xb5, 0x2f, 0xfd] => ("this is a zstd archive", "unpack it with `zstd -d`"),
        [b'#', b'R', b'O', b'S'] => ("this is a ROS bag, not a pcap", "give it as a bag"),
        [0x55, 0x50..=0x5f, ..] => ("this is a WT901C byte log, not a pcap", "give it as the IMU's file"),
        _ => (
            "this is no pcap file: its first four bytes are none of the known marks",
            "give a LiDAR capture, as of `tcpdump -w`",
        ),
    };
    let [a, b, c, d] = magic;
    refused(path, 0, &format!("{cause} (it begins with {a:02x} {b:02x} {c:02x} {d:02x})"), remedy)
}

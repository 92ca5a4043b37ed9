//! Writes a capture as `tcpdump` on the host's Ethernet interface would have.

use std::io::{Error, ErrorKind, Result, Write};
use std::net::{Ipv4Addr, SocketAddrV4};

const ETHERNET_HEADER: usize = 14;
const IPV4_HEADER: usize = 20;
const UDP_HEADER: usize = 8;

/// Writes UDP datagrams as a classic little-endian microsecond pcap of Ethernet packets.
#[derive(Debug)]
pub struct PcapWriter<W> {
    out: W,
}

impl<W: Write> PcapWriter<W> {
    /// Writes the file header.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn new(mut out: W) -> Result<Self> {
        out.write_all(&0xa1b2_c3d4_u32.to_le_bytes())?;
        out.write_all(&[2, 0, 4, 0])?; // version 2.4
        for value in [0, 0, 65_535, 1_u32] {
            // time zone, accuracy, snap length, Ethernet
            out.write_all(&value.to_le_bytes())?;
        }
        Ok(Self { out })
    }

    /// Writes one datagram, captured at `time_ns` since 1970.
    ///
    /// # Errors
    /// Those of the output; `InvalidInput` for a payload that no IPv4 packet can hold and for a time before 1970 or
    /// after 2106, which the format cannot.
    pub fn write_udp(
        &mut self,
        time_ns: i64,
        source: SocketAddrV4,
        destination: SocketAddrV4,
        payload: &[u8],
    ) -> Result<()> {
        let too_long = |_| Error::new(ErrorKind::InvalidInput, "a UDP payload is at most 65507 bytes");
        let udp_length = u16::try_from(UDP_HEADER + payload.len()).map_err(too_long)?;
        let ip_length = u16::try_from(IPV4_HEADER + UDP_HEADER + payload.len()).map_err(too_long)?;
        let captured = (ETHERNET_HEADER as u32) + u32::from(ip_length);
        let seconds = u32::try_from(time_ns.div_euclid(1_000_000_000)).map_err(|_| {
            Error::new(ErrorKind::InvalidInput, format!("{time_ns} ns is not in 1970 to 2106"))
        })?;
        let microseconds = (time_ns.rem_euclid(1_000_000_000) / 1000) as u32;
        for field in [seconds, microseconds, captured, captured] {
            self.out.write_all(&field.to_le_bytes())?;
        }
        self.out.write_all(&hardware_address(*destination.ip()))?;
        self.out.write_all(&hardware_address(*source.ip()))?;
        self.out.write_all(&[0x08, 0x00])?;
        self.out.write_all(&ipv4_header(ip_length, *source.ip(), *destination.ip()))?;
        // A UDP checksum of zero means "none" over IPv4.
        for field in [source.port(), destination.port(), udp_length, 0] {
            self.out.write_all(&field.to_be_bytes())?;
        }
        self.out.write_all(payload)
    }

    /// Flushes and gives the output back.
    ///
    /// # Errors
    /// Those of the output.
    pub fn finish(mut self) -> Result<W> {
        self.out.flush()?;
        Ok(self.out)
    }
}

/// A locally administered address made of the IPv4 address.
fn hardware_address(ip: Ipv4Addr) -> [u8; 6] {
    let [a, b, c, d] = ip.octets();
    [0x02, 0, a, b, c, d]
}

fn ipv4_header(length: u16, source: Ipv4Addr, destination: Ipv4Addr) -> [u8; IPV4_HEADER] {
    let mut header = [0x45, 0, 0, 0, 0, 0, 0x40, 0, 64, 17, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    let mut put = |at: usize, bytes: &[u8]| {
        for (to, from) in header.iter_mut().skip(at).zip(bytes) {
            *to = *from;
        }
    };
    put(2, &length.to_be_bytes());
    put(12, &source.octets());
    put(16, &destination.octets());
    // RFC 791: the one's complement of the one's complement sum of all 16-bit words.
    let words = header.as_chunks::<2>().0.iter().map(|word| u32::from(u16::from_be_bytes(*word)));
    let mut sum: u32 = words.sum();
    while sum > 0xffff {
        sum = (sum & 0xffff) + (sum >> 16);
    }
    let [high, low] = (!(sum as u16)).to_be_bytes();
    header[10] = high;
    header[11] = low;
    header
}

//! From a captured link-layer packet to the UDP payload inside it.

use std::net::{Ipv4Addr, SocketAddrV4};
use std::ops::Range;

/// How the packets of a capture begin (the file header's link type).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LinkType {
    /// BSD loopback: an address family of four bytes.
    Loopback,
    Ethernet,
    /// IP without a link header.
    RawIp,
    /// Linux "cooked", as of `tcpdump -i any`.
    LinuxCooked,
    LinuxCooked2,
}

impl LinkType {
    pub(super) fn from_wire(value: u32) -> Option<Self> {
        // The upper half may hold the length of a frame check sequence.
        Some(match value & 0xffff {
            0 => Self::Loopback,
            1 => Self::Ethernet,
            12 | 14 | 101 | 228 => Self::RawIp,
            113 => Self::LinuxCooked,
            276 => Self::LinuxCooked2,
            _ => return None,
        })
    }
}

/// What a packet turned out to be.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Packet {
    /// A whole UDP datagram over IPv4; the range is its payload within the packet.
    Udp { source: SocketAddrV4, destination: SocketAddrV4, payload: Range<usize> },
    /// Something else: ARP, IPv6, TCP.
    Other,
    /// A part of a fragmented datagram.
    Fragment,
    /// Cut by the capture's snap length, or inconsistent.
    Cut,
}

const ETHER_IPV4: u16 = 0x0800;
const ETHER_VLAN: [u16; 3] = [0x8100, 0x88a8, 0x9100];
const PROTOCOL_UDP: u8 = 17;

pub(super) fn classify(link: LinkType, packet: &[u8]) -> Packet {
    match network_layer(link, packet) {
        Some(start) => ipv4(packet, start).unwrap_or(Packet::Cut),
        None => Packet::Other,
    }
}

/// Where the IPv4 header begins; `None` if something else is inside.
fn network_layer(link: LinkType, packet: &[u8]) -> Option<usize> {
    let (mut kind, mut start) = match link {
        LinkType::RawIp => (ETHER_IPV4, 0),
        LinkType::Loopback => {
            // The family is in the byte order of the machine that captured.
            let family = *packet.first_chunk::<4>()?;
            (if family == [2, 0, 0, 0] || family == [0, 0, 0, 2] { ETHER_IPV4 } else { 0 }, 4)
        }
        LinkType::Ethernet => (be16(packet, 12)?, 14),
        LinkType::LinuxCooked => (be16(packet, 14)?, 16),
        LinkType::LinuxCooked2 => (be16(packet, 0)?, 20),
    };
    while ETHER_VLAN.contains(&kind) {
        kind = be16(packet, start + 2)?;
        start += 4;
    }
    (kind == ETHER_IPV4 && packet.get(start)? >> 4 == 4).then_some(start)
}

/// `None` where the packet ends before its own length fields say.
fn ipv4(packet: &[u8], start: usize) -> Option<Packet> {
    let header = packet.get(start..)?.first_chunk::<20>()?;
    let header_bytes = usize::from(header[0] & 0xf) * 4;
    if header_bytes < 20 {
        return None;
    }
    if header[9] != PROTOCOL_UDP {
        return Some(Packet::Other);
    }
    // More fragments follow, or this is not the first.
    if u16::from_be_bytes([header[6], header[7]]) & 0x3fff != 0 {
        return Some(Packet::Fragment);
    }
    let udp = start + header_bytes;
    let length = usize::from(be16(packet, udp + 4)?);
    if length < 8 || udp + length > packet.len() {
        return None;
    }
    let source = Ipv4Addr::new(header[12], header[13], header[14], header[15]);
    let destination = Ipv4Addr::new(header[16], header[17], header[18], header[19]);
    Some(Packet::Udp {
        source: SocketAddrV4::new(source, be16(packet, udp)?),
        destination: SocketAddrV4::new(destination, be16(packet, udp + 2)?),
        payload: udp + 8..udp + length,
    })
}

fn be16(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_be_bytes(*bytes.get(at..)?.first_chunk()?))
}
